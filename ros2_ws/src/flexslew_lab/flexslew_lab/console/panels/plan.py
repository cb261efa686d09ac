"""Plan a manoeuvre, see the iterations and the curve; then let it be flown, or drop it."""

from dataclasses import fields, replace
from functools import partial
from math import ceil
from typing import Any

import numpy as np

from flexslew_control.planners import OPTIMIZED, PLANNERS, plan_settings
from flexslew_control.plans.known_motion import ATTITUDE_ERROR, PREDICTED
from flexslew_lab.console.charting import TIME, ChartData, chart_update, options
from flexslew_lab.console.desk import PanelContext, ReplyLine, line
from flexslew_lab.console.forms import Form, FormKey, moment, number_of, text_of
from flexslew_lab.console.history import Curve
from flexslew_lab.console.link import Iterate, RequestResult
from flexslew_lab.short_values import short
from flexslew_plant.errors import BadInput
from flexslew_plant.graph import topics
from flexslew_plant.own_code import is_user_code
from flexslew_plant.yaml_data import load_yaml, yaml_text

_GOAL = "goal of "
_MAX_ITERATIONS = 8  # iterations
_SOON = 5.0  # from now to the start that a button writes [s]
# keys that have fields of their own, or are completed from the bench
_FIELDS = ("method", "goal", "start", "duration", "model", "initial", "feedback")
_MODEL_HINT = "that was accepted under Experiment, instead of the bench's own testbed section"


class PlanPanel:
    """Goal, method, duration, start; a draft is drawn, and flown from its start on if adopted.

    Args:
        context: of the page.
    """

    def __init__(self, context: PanelContext) -> None:
        gui = context.gui
        self._context, self._view, self._link = context, context.view, context.link
        slews = tuple(name for name, entry in PLANNERS.items() if entry.slews)
        self._method = gui.choice("Method", slews, value=OPTIMIZED.name)
        self._place = gui.folder("Manoeuvre")
        self._use_model = gui.check("Believe the identified model", True, hint=_MODEL_HINT)
        self._use_model.visible = False
        self._form: Form | None = None
        self._joints: Any = None
        hint = f"write a start {_SOON:g} s from now"
        soon = gui.button(f"In {_SOON:g} s", hint=hint, color="blue-grey-8")
        context.click(soon, self._start_soon)
        with gui.add("row"):
            context.click(gui.button("Plan"), self._plan)
            cancel = gui.button("Cancel planning", color="blue-grey-8")
            context.click(cancel, lambda who: context.link.cancel())
        self._accept_button = gui.button("Adopt the draft", hint="fly it from its start on")
        self._reject_button = gui.button("Refuse the draft", color="blue-grey-8")
        for button, word in ((self._accept_button, "adopt"), (self._reject_button, "refuse")):
            context.click(button, partial(self._decide, word))
        self._reply = ReplyLine(context)
        self._progress = gui.html()
        self._curve_folder = gui.folder("Planned course", visible=False)  # below what is clicked
        with self._curve_folder:
            self._figures = gui.html()
            self._curve = gui.add("chart", "planned course", data=_chart([], TIME))
            self._effort = gui.add("chart", "planned effort", data=_chart([], TIME))
        self._iterations: list[str] = []
        self._draft: Any = None  # that waits for a decision
        self._last_plan = ("", "")  # hash of the plan, and what it is

    def refresh(self) -> None:
        """Make the form when the joints are known, and draw a plan that is new."""
        joints, plan = self._view.joints, self._view.plan
        self._use_model.visible = self._context.identified is not None
        if joints is not None and joints != self._joints:
            self._joints = joints
            if self._form is not None:
                self._form.remove()
            goal_joints = zip(joints.names, joints.units, strict=True)
            keys = [FormKey(f"{_GOAL}{name}", f"[{unit}]", "0.0") for name, unit in goal_joints]
            keys += [
                FormKey(
                    "duration", "of the manoeuvre [s]; empty: what the method needs, or 25 s", ""
                ),
                FormKey("start", "simulated time, later than now [s]", ""),
                FormKey("more", "other keys, YAML: {functions: 12}, {method: my_shaper.py:Shaper}"),
            ]
            self._form = Form(self._context, keys, self._place)
        is_pending = self._draft is not None
        for button in (self._accept_button, self._reject_button):
            if button.visible != is_pending:
                button.visible = is_pending
        visible_plan, kind = (self._draft, "draft, not flown") if is_pending else (plan, "plan")
        state = (visible_plan.hash, kind) if visible_plan is not None else ("", "")
        if state != self._last_plan:
            if plan is not None and not self._last_plan[0] and plan.method in self._method.options:
                self._fill(plan)  # as the bench flies already
            self._last_plan = state
            self._draw(visible_plan, kind)

    def _fill(self, plan: Any) -> None:
        """Write the request of a plan into the fields."""
        self._method.value = plan.method
        try:
            request = load_yaml(plan.request, "plan")
        except BadInput:  # of a planner that is not ours
            return
        if self._form is None or not isinstance(request, dict):
            return
        goal = request.get("goal")
        for name, value in goal.items() if isinstance(goal, dict) else ():
            if self._joints is not None and name in self._joints.names:
                self._form.set(f"{_GOAL}{name}", text_of(value))
        self._form.set("duration", text_of(request.get("duration")))
        known = {f.name: f.default for f in fields(PLANNERS[plan.method].settings)}
        more = {k: v for k, v in request.items() if k not in _FIELDS and known.get(k, v) != v}
        self._form.set("more", text_of(more or None))

    def _start_soon(self, who: str) -> None:
        if self._form is not None:
            self._form.set("start", f"{ceil(self._view.time + _SOON):g}")

    def _plan(self, who: str) -> None:
        if self._form is None:
            self._reply.tell(RequestResult(False, "no testbed has announced itself yet"))
            return
        instead = {"start": self._view.time + 1.0}
        if self._joints is not None:
            instead |= {f"{_GOAL}{name}": 0.0 for name in self._joints.names}
        try:
            values = self._form.checked(self._request, instead)
        except BadInput as error:
            self._reply.tell(RequestResult(False, str(error)))
            return
        if values is None:
            return
        self._iterations = []
        self._progress.content = ""
        self._reply.tell(RequestResult(True, "planning ..."))
        text = yaml_text(values, flow=True)
        self._link.draft(text, who, self._iterate, self._on_plan)

    def _on_plan(self, result: RequestResult, plan: Any) -> None:
        self._draft = plan or self._draft
        self._reply.tell(result)

    def _decide(self, word: str, who: str) -> None:
        if self._draft is None:
            self._reply.tell(RequestResult(False, "there is no draft to decide on"))
            return
        draft = self._draft

        def on_decision(result: RequestResult) -> None:
            if (result.ok or word == "refuse") and self._draft is draft:
                self._draft = None

        values = {"action": f"{word} {draft.hash}", "who": who}
        self._reply.ask(topics.DECIDE_PLAN, values, on_decision)

    def _request(self, given: dict[str, Any]) -> dict[str, Any]:
        """Return the `plan` section.

        Raises:
            BadInput: beginning with the field.
        """
        goal = {}
        for key in [key for key in given if key.startswith(_GOAL)]:
            goal[key.removeprefix(_GOAL)] = number_of(key, given[key])
        more = given.get("more", {})
        if not isinstance(more, dict):
            raise BadInput("give keys, for example {functions: 12}", key="more")
        if "start" not in given:
            raise BadInput(f"is missing; the bench is at {self._view.time:.2f} s", key="start")
        start = moment("start", given["start"])
        if start <= self._view.time:
            words = f"{start:g} is past: the bench is at {self._view.time:.2f} s"
            raise BadInput(words, key="start")
        values = {"method": self._method.value, "goal": goal, "start": start, **more}
        if "duration" in given:
            values["duration"] = given["duration"]
        if self._context.identified is not None and self._use_model.value:
            values.setdefault("model", self._context.identified)
        if not is_user_code(str(values["method"])):  # no page runs a planner of the user's own
            try:
                plan_settings(values, "")
            except BadInput as error:
                why = error.refusal
                key = why.key.replace("goal.", _GOAL, 1)
                raise BadInput(replace(why, key=key)) from None
        return values

    def _iterate(self, iteration: Iterate) -> None:
        words = (
            f"{iteration.number}: J {iteration.objective:.4e}, |Y| "
            f"{iteration.norm_terminal_error:.2e}"
        )
        self._iterations = [*self._iterations, words][-_MAX_ITERATIONS:]
        self._progress.content = "".join(line(one) for one in self._iterations)

    def _draw(self, plan: Any, kind: str) -> None:
        """Show the planned positions; without a plan nothing."""
        self._curve_folder.visible = plan is not None
        if plan is None:
            return
        known = self._view.joints
        names = known.names if known is not None else ()
        units = dict(zip(names, known.units, strict=True)) if known is not None else {}
        efforts = dict(zip(names, known.effort_units, strict=True)) if known is not None else {}
        title = f"{TIME}; {kind}: {plan.method}, from {plan.start:g} s on"
        self._curve.data = _chart(_curves(plan, plan.position, "planned", units), title)
        effort = _curves(plan, plan.effort, "effort of", efforts)
        self._effort.visible = any(curve.value.any() for curve in effort)
        self._effort.data = _chart(effort, TIME)
        self._figures.content = "".join(map(line, _figures(plan, units, efforts)))


def _curves(plan: Any, values: Any, words: str, units: dict[str, str]) -> list[Curve]:
    """Return a curve for each joint of a plan, of about 500 points."""
    rows = np.asarray(values, dtype=float).reshape(-1, max(len(plan.joint_names), 1))
    every = max(1, len(rows) // 500)
    time = (plan.start + plan.period * np.arange(len(rows)))[::every]
    return [
        Curve(f"{words} {name} [{units.get(name, '-')}]", time, rows[::every, k])
        for k, name in enumerate(plan.joint_names)
    ]


def _figures(plan: Any, units: dict[str, str], efforts: dict[str, str]) -> list[str]:
    """Return lines with the largest efforts and the predicted residual of a plan."""
    try:
        summary = load_yaml(plan.summary, "plan") or {}
    except BadInput:
        return []
    rows = []
    peaks = np.abs(np.asarray(plan.effort, dtype=float).reshape(-1, max(len(plan.joint_names), 1)))
    if peaks.any():
        peak = zip(plan.joint_names, peaks.max(axis=0), strict=True)
        words = ", ".join(f"{name} {short(v)} {efforts.get(name, '')}" for name, v in peak)
        rows.append(f"largest effort: {words}")
    if isinstance(tip := summary.get(PREDICTED), float):
        rows.append(f"predicted residual: tip deflection {short(tip)} m")
    errors = summary.get(ATTITUDE_ERROR)
    for name, value in errors.items() if isinstance(errors, dict) else ():
        rows.append(f"predicted residual: {name} {short(value)} {units.get(name, '')}")
    return rows


def _chart(curves: list[Curve], title: str) -> ChartData:
    axis = curves[0].time if curves else np.zeros(0)
    return ChartData(
        options(curves, title), chart_update(axis, [c.value for c in curves], np.zeros(0))
    )
