"""Plan a manoeuvre, see the iterations and the curve; then let it be flown, or drop it."""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from flexslew_control.planners import OPTIMIZED, PLANNERS, plan_settings
from flexslew_lab.console.charting import TIME, ChartData, news, options
from flexslew_lab.console.desk import Desk, DeskReply, line
from flexslew_lab.console.forms import Form, FormKey, moment, number_of
from flexslew_lab.console.history import Curve
from flexslew_lab.console.link import Iterate, RequestResult
from flexslew_plant.errors import BadInput
from flexslew_plant.graph import topics
from flexslew_plant.own_code import is_own_code
from flexslew_plant.yaml_data import yaml_text

_GOAL = "goal of "
_SHOWN = 8  # iterations
_BELIEVE = "that was accepted under Experiment, instead of the bench's own testbed section"


class PlanPanel:
    """Goal, method, duration, start; a draft is drawn, and flown from its start on if adopted.

    Args:
        desk: of the page.
    """

    def __init__(self, desk: Desk) -> None:
        gui = desk.gui
        self._desk, self._view, self._link = desk, desk.view, desk.link
        slews = tuple(name for name, entry in PLANNERS.items() if entry.slews)
        self._method = gui.choice("Method", slews, value=OPTIMIZED.name)
        self._place = gui.folder("Manoeuvre")
        self._believe = gui.check("Believe the identified model", True, hint=_BELIEVE)
        self._believe.visible = False
        self._form: Form | None = None
        self._joints: Any = None
        desk.click(gui.button("Plan"), self._plan)
        desk.click(gui.button("Cancel planning"), lambda who: desk.link.cancel())
        self._adopt = gui.button("Adopt the draft", hint="fly it from its start on")
        self._refuse = gui.button("Refuse the draft", color="blue-grey-8")
        for button, word in ((self._adopt, "adopt"), (self._refuse, "refuse")):
            desk.click(button, partial(self._decide, word))
        self._reply = DeskReply(desk)
        self._progress = gui.html()
        self._course = gui.folder("Planned course", visible=False)  # below what is clicked
        with self._course:
            self._curve = gui.add("chart", "planned course", data=_chart([], TIME))
        self._iterations: list[str] = []
        self._draft: Any = None  # that waits for a decision
        self._drawn = ("", "")  # hash of the plan, and what it is

    def refresh(self) -> None:
        """Make the form when the joints are known, and draw a plan that is new."""
        joints, plan = self._view.joints, self._view.plan
        self._believe.visible = self._desk.identified is not None
        if joints is not None and joints != self._joints:
            self._joints = joints
            if self._form is not None:
                self._form.remove()
            goals = zip(joints.names, joints.units, strict=True)
            keys = [FormKey(f"{_GOAL}{name}", f"[{unit}]", "0.0") for name, unit in goals]
            keys += [
                FormKey(
                    "duration", "of the manoeuvre [s]; empty: what the method needs, or 25 s", ""
                ),
                FormKey("start", "simulated time, later than now [s]", ""),
                FormKey("more", "other keys, YAML: {functions: 12}, {method: my_shaper.py:Shaper}"),
            ]
            self._form = Form(self._desk, keys, self._place)
        waits = self._draft is not None
        for button in (self._adopt, self._refuse):
            if button.visible != waits:
                button.visible = waits
        shown, kind = (self._draft, "draft, not flown") if waits else (plan, "plan")
        state = (shown.hash, kind) if shown is not None else ("", "")
        if state != self._drawn:
            if plan is not None and not self._drawn[0] and plan.method in self._method.options:
                self._method.value = plan.method  # as the bench flies already
            self._drawn = state
            self._draw(shown, kind)

    def _plan(self, who: str) -> None:
        if self._form is None:
            self._reply.tell(RequestResult(False, "no testbed has announced itself yet"))
            return
        given = self._form.values()
        if given is None:
            return
        try:
            values = self._request(given)
        except BadInput as error:
            why = error.refusal
            if not self._form.refuse(replace(why, key=why.key.replace("goal.", _GOAL, 1))):
                self._reply.tell(RequestResult(False, str(error)))
            return
        self._iterations = []
        self._progress.content = ""
        self._reply.tell(RequestResult(True, "planning ..."))
        text = yaml_text(values, flow=True)
        self._link.draft(text, who, self._iterate, self._drafted)

    def _drafted(self, result: RequestResult, plan: Any) -> None:
        self._draft = plan or self._draft
        self._reply.tell(result)

    def _decide(self, word: str, who: str) -> None:
        if self._draft is None:
            self._reply.tell(RequestResult(False, "there is no draft to decide on"))
            return
        draft = self._draft

        def decided(result: RequestResult) -> None:
            if (result.ok or word == "refuse") and self._draft is draft:
                self._draft = None

        values = {"action": f"{word} {draft.hash}", "who": who}
        self._reply.ask(topics.DECIDE_PLAN, values, decided)

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
        if self._desk.identified is not None and self._believe.value:
            values.setdefault("model", self._desk.identified)
        if not is_own_code(str(values["method"])):  # no page runs a planner of the user's own
            plan_settings(values, "")
        return values

    def _iterate(self, news: Iterate) -> None:
        words = f"{news.number}: J {news.objective:.4e}, |Y| {news.norm_terminal_error:.2e}"
        self._iterations = [*self._iterations, words][-_SHOWN:]
        self._progress.content = "".join(line(one) for one in self._iterations)

    def _draw(self, plan: Any, kind: str) -> None:
        """Show the planned positions; without a plan nothing."""
        self._course.visible = plan is not None
        if plan is None:
            return
        joints = len(plan.joint_names)
        rows = np.asarray(plan.position, dtype=float).reshape(-1, max(joints, 1))
        every = max(1, len(rows) // 500)
        time = plan.start + plan.period * np.arange(len(rows))
        known = self._view.joints
        units = dict(zip(known.names, known.units, strict=True)) if known is not None else {}
        curves = [
            Curve(f"planned {name} [{units.get(name, '-')}]", time[::every], rows[::every, k])
            for k, name in enumerate(plan.joint_names)
        ]
        title = f"{TIME}; {kind}: {plan.method}, from {plan.start:g} s on"
        self._curve.data = _chart(curves, title)


def _chart(curves: list[Curve], title: str) -> ChartData:
    axis = curves[0].time if curves else np.zeros(0)
    return ChartData(options(curves, title), news(axis, [c.value for c in curves], np.zeros(0)))
