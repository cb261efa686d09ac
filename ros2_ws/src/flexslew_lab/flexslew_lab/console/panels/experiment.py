"""Shake the bench, see its responses grow, identify it from them, and let plans believe that."""

from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from flexslew_control.message_fields import plan_of
from flexslew_control.plan import Plan
from flexslew_control.planners import plan_settings
from flexslew_control.planners.excitation.excitation import EXCITATION, Excitation
from flexslew_lab.console.charting import ChartData, chart_update, options, with_log_axes
from flexslew_lab.console.desk import PanelContext, ReplyLine, line
from flexslew_lab.console.forms import Form, keys_of, moment, set_options
from flexslew_lab.console.history import Curve
from flexslew_lab.console.link import RequestResult
from flexslew_lab.console.shaking import LEAST, progress, record_so_far, response_so_far
from flexslew_lab.identification.modal.modal_fit import modal_response
from flexslew_lab.identification.modal.modes import ModalModel, identify_modes
from flexslew_lab.identification.modal.parameter_groups import groups_of
from flexslew_lab.identification.model_file import file_text, testbed_of, write_model
from flexslew_lab.identification.page import format_interval, per_effort
from flexslew_lab.identification.records.record import Record
from flexslew_lab.identification.responses.frequency_response import FrequencyResponse
from flexslew_plant.counted import count_text
from flexslew_plant.errors import BadInput
from flexslew_plant.graph import topics
from flexslew_plant.own_code import one_line
from flexslew_plant.settings import plain
from flexslew_plant.yaml_data import yaml_text

MODEL = "identified.yaml"
_NONE = "no responses yet"
_OTHERS = ("method", "goal", "model", "initial", "feedback")  # keys that the page does not ask for


class ExperimentPanel:
    """An excitation, the responses while it is flown, and the model that they give.

    Args:
        context: of the page.
    """

    def __init__(self, context: PanelContext) -> None:
        gui = context.gui
        self._context, self._view, self._link = context, context.view, context.link
        self._form = Form(context, keys_of(Excitation, without=_OTHERS), gui.folder("Excitation"))
        self._form.set("start", "")
        context.click(gui.button("Plan the experiment"), self._plan)
        self._run_button = gui.button("Fly the experiment", hint="from its start on", visible=False)
        self._drop = gui.button("Drop the experiment", color="blue-grey-8", visible=False)
        for button, word in ((self._run_button, "adopt"), (self._drop, "refuse")):
            context.click(button, partial(self._decide, word))
        self._reply, self._far = ReplyLine(context), gui.html()
        context.click(gui.button("Identify", hint="from what was measured so far"), self._identify)
        self._accept = gui.button("Accept the model", hint="for plans to believe", visible=False)
        context.click(self._accept, self._accepted)
        self._outcome, self._modes = ReplyLine(context), gui.html()
        self._output = gui.choice("Response of", (_NONE,))
        self._charts = gui.folder("Frequency responses", visible=False)
        with self._charts:
            empty_data = ChartData(options([]), chart_update(np.zeros(0), [], np.zeros(0)))
            self._size = gui.add("chart", "magnitude", data=empty_data)
            self._coherence = gui.add("chart", "coherence", data=empty_data)
        self._draft: Any = None
        self._active_plan: tuple[str, Plan] | None = None  # hash and plan that shakes the bench
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="experiment")
        self._response_job: Future[FrequencyResponse] | None = None
        self._model_job: Future[ModalModel] | None = None
        self._record: Record | None = None  # of the whole experiment
        self._periods = 0  # periods of the requested responses
        self._response: FrequencyResponse | None = None
        self._model: ModalModel | None = None
        self._last_state: tuple[object, ...] = ()

    def refresh(self) -> None:
        """Follow the experiment in charge, and draw what is new."""
        for button in (self._run_button, self._drop):
            button.visible = self._draft is not None
        self._track_plan()
        self._take()
        if self._active_plan is not None:
            times = self._view.measured.time
            far = progress(
                self._active_plan[1], float(times[-1]) if times.size else self._view.time
            )
            self._far.content = line(far.words)
            if far.periods >= LEAST and far.periods > self._periods and self._response_job is None:
                self._request_responses(self._active_plan[1], far.periods)
        self._accept.visible = self._model is not None
        self._draw()

    def _track_plan(self) -> None:
        """Listen to the sensors while an experiment is the plan, or may become it."""
        message = self._view.plan
        is_active = message is not None and message.method == EXCITATION.name
        self._link.measure(self._draft is not None or (is_active and self._record is None))
        if not is_active or (
            self._active_plan is not None and self._active_plan[0] == message.hash
        ):
            return
        self._active_plan = message.hash, plan_of(message, "the experiment")
        self._periods, self._response, self._model, self._record = 0, None, None, None
        self._modes.content = ""

    def _plan(self, who: str) -> None:
        try:
            values = self._form.checked(self._request, {"start": self._view.time + 1.0})
        except BadInput as error:
            self._reply.tell(RequestResult(False, str(error)))
            return
        if values is None:
            return
        self._reply.tell(RequestResult(True, "planning ..."))
        self._link.draft(yaml_text(values, flow=True), who, lambda news: None, self._on_plan)

    def _request(self, given: dict[str, Any]) -> dict[str, Any]:
        """Return the `plan` section.

        Raises:
            BadInput: beginning with the field.
        """
        now = f"the bench is at {self._view.time:.2f} s"
        if "start" not in given:
            raise BadInput(f"is missing; {now}", key="start")
        if moment("start", given["start"]) <= self._view.time:
            raise BadInput(f"{given['start']:g} is past: {now}", key="start")
        values = {"method": EXCITATION.name, **given}
        plan_settings(values, "")
        return values

    def _on_plan(self, result: RequestResult, plan: Any) -> None:
        self._draft = plan or self._draft
        self._reply.tell(result)

    def _decide(self, word: str, who: str) -> None:
        draft = self._draft
        if draft is None:
            self._reply.tell(RequestResult(False, "there is no experiment to decide on"))
            return

        def on_decision(result: RequestResult) -> None:
            if (result.ok or word == "refuse") and self._draft is draft:
                self._draft = None

        values = {"action": f"{word} {draft.hash}", "who": who}
        self._reply.ask(topics.DECIDE_PLAN, values, on_decision)

    def _request_responses(self, plan: Plan, periods: int) -> None:
        self._periods = periods
        if (record := self._measured_record(plan)) is not None:
            self._response_job = self._worker.submit(response_so_far, record, plan, periods)

    def _identify(self, who: str) -> None:
        if self._active_plan is None:
            self._outcome.tell(RequestResult(False, "no experiment was flown yet"))
            return
        if self._model_job is not None:
            return
        plan = self._active_plan[1]
        if (record := self._measured_record(plan)) is None:
            return
        self._outcome.tell(RequestResult(True, f"identifying {record.duration:.0f} s ..."))
        low, high = plan.summary["band"]
        self._model_job = self._worker.submit(identify_modes, record, (low, high))

    def _measured_record(self, plan: Plan) -> Record | None:
        """Return the measurements so far; None if there are none, with the reason shown."""
        if self._record is not None:
            return self._record
        try:
            record = record_so_far(self._view, plan)
        except BadInput as error:
            self._outcome.tell(RequestResult(False, str(error)))
            return None
        if record.ticks >= round(plan.summary["duration"] / plan.period):
            self._record = record
        return record

    def _take(self) -> None:
        """Take what the worker has done."""
        if self._response_job is not None and self._response_job.done():
            done, self._response_job = self._response_job, None
            if (error := done.exception()) is None:
                self._response = done.result()
            else:
                self._outcome.tell(_failure_result(error))
        if self._model_job is not None and self._model_job.done():
            found, self._model_job = self._model_job, None
            if (error := found.exception()) is None:
                self._model = found.result()
                self._outcome.tell(
                    RequestResult(True, f"{count_text(len(self._model.modes), 'mode')} found")
                )
                self._modes.content = "".join(line(one) for one in _words(self._model))
            else:
                self._outcome.tell(_failure_result(error))

    def _accepted(self, who: str) -> None:
        if self._model is None:
            self._outcome.tell(RequestResult(False, "identify the bench first"))
            return
        try:
            section = plain(testbed_of(self._model))
            words = "plans believe it"
            if self._link.folder:
                path = Path(self._link.folder) / MODEL
                write_model(path, file_text(self._model)[0])
                words = f"{words}, and {path} holds it"
        except BadInput as error:
            self._outcome.tell(RequestResult(False, str(error)))
            return
        self._context.accept(section)
        self._outcome.tell(RequestResult(True, words))

    def _draw(self) -> None:
        """Show the magnitudes of one output with their bands, the model over them."""
        found = self._response
        self._charts.visible = found is not None
        if found is None:
            set_options(self._output, (), _NONE)
            return
        set_options(self._output, tuple(o.name for o in found.outputs), _NONE)
        state = (id(found), id(self._model), self._output.value)
        if state == self._last_state:
            return
        self._last_state = state
        row = next(k for k, o in enumerate(found.outputs) if o.name == self._output.value)
        curves = _magnitudes(found, row) + _model_magnitudes(found, self._model, row)
        output = f"|{self._output.value}| [{per_effort(found, found.outputs[row])}]"
        title = f"{output}, frequency [rad/s], {found.periods} periods"
        self._size.data = ChartData(with_log_axes(options(curves, title)), _rows(curves))
        coherence = [Curve(self._output.value, found.frequency, found.coherence[:, row])]
        layout = options(coherence, "coherence [-], frequency [rad/s]")
        self._coherence.data = ChartData(layout, _rows(coherence))


def _magnitudes(found: FrequencyResponse, row: int) -> list[Curve]:
    """Return the magnitudes from every effort, each between the edges of its band."""
    curves = []
    for i, name in enumerate(found.inputs):
        size, radius = np.abs(found.response[:, row, i]), found.radius[:, row, i]
        curves.append(Curve(f"from {name}", found.frequency, size, color=i))
        for word, edge in (("at most", size + radius), ("at least", size - radius)):
            plot_edge = np.maximum(edge, 1e-3 * size)  # a logarithm has no 0
            label = f"{word}, from {name}"
            curves.append(Curve(label, found.frequency, plot_edge, dashed=True, color=i))
    return curves


def _model_magnitudes(found: FrequencyResponse, model: ModalModel | None, row: int) -> list[Curve]:
    """Return the magnitudes of the model, where it has the output."""
    if model is None:
        return []
    groups = groups_of(model.record)
    displacements = [g for g in groups if g.position >= 0]
    place = next((k for k, g in enumerate(displacements) if row in (g.position, g.rate)), None)
    if place is None:
        return []
    response = modal_response(model.fit, groups, found.frequency)[:, place]
    if row == displacements[place].rate:
        response = 1j * found.frequency[:, None] * response
    return [
        Curve(f"model, from {name}", found.frequency, np.abs(response[:, i]), color=4 + i)
        for i, name in enumerate(found.inputs)
    ]


def _rows(curves: list[Curve]) -> dict[str, Any]:
    return chart_update(curves[0].time, [c.value for c in curves], np.zeros(0))


def _words(model: ModalModel) -> list[str]:
    """Return modes and inertias, a line each."""
    rows = [
        f"mode {k}: {format_interval(m.frequency)} rad/s, damping ratio "
        f"{format_interval(m.damping_ratio)}"
        for k, m in enumerate(model.modes, 1)
    ]
    rows += [
        f"inertia, {name}: {format_interval(row[k])}"
        for k, (name, row) in enumerate(zip(model.record.inputs, model.inertia, strict=False))
    ]
    return [*rows, *model.doubts]


def _failure_result(error: BaseException) -> RequestResult:
    """Return why the worker has failed: of a log of any bench, which may hold anything."""
    if isinstance(error, BadInput) or not isinstance(error, Exception):
        return RequestResult(False, str(error))
    return RequestResult(False, one_line(error))
