"""Give the bench to another controller."""

from typing import Any

from flexslew_lab.console.desk import PanelContext, ReplyLine
from flexslew_lab.console.forms import OpenedOn, moment, not_negative
from flexslew_lab.console.link import RequestResult
from flexslew_plant.errors import BadInput
from flexslew_plant.graph import topics

NO_CONTROLLER = "(none found)"


class SwapPanel:
    """A list of controllers, and when and how to switch.

    Args:
        context: of the page.
    """

    def __init__(self, context: PanelContext) -> None:
        gui = context.gui
        self._view = context.view
        self._who = gui.choice("Controller", (NO_CONTROLLER,))
        self._opened = OpenedOn(self._who)
        self._at = gui.number("At [s]", 0.0, hint="simulated time; 0: the next tick")
        self._strict = gui.check("Strict", False, hint="refuse a larger step of the effort")
        self._step = gui.number("Largest step [N m or N]", 1.0, hint="of the effort")
        context.click(gui.button("Switch"), self._switch)
        self._reply = ReplyLine(context)

    def refresh(self) -> None:
        """List the controllers on the graph; the active one is chosen at first."""
        known = tuple(sorted(self._view.controllers))
        self._opened.offer(known, NO_CONTROLLER, self._view.now.active)

    def _switch(self, who: str) -> None:
        name = str(self._who.value)
        try:
            values = switch_request(name, who) | {
                "at": moment("At", self._at.value),
                "strict": self._strict.value,
                "max_effort_step": not_negative("Largest step", self._step.value),
            }
        except BadInput as error:
            self._reply.tell(RequestResult(False, str(error)))
            return
        now = self._view.now
        states = {name, now.active}  # the state of the bench may come after the answer

        def then(result: RequestResult) -> None:
            if result.ok:
                self._reply.tell(result, lambda: self._view.now.active in states)

        done = lambda: self._view.now.active == name  # noqa: E731
        self._reply.ask(topics.SWITCH_CONTROLLER, values, then, done)


def switch_request(name: str, who: str) -> dict[str, Any]:
    """Return the request for a switch to a controller at the next tick."""
    step = {"strict": False, "max_effort_step": 1.0}
    return {"controller": name, "at": 0.0, **step, "timeout": 2.0, "who": who}
