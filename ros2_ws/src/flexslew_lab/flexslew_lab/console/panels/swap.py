"""Give the bench to another controller."""

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
        try:
            values = {
                "controller": self._who.value,
                "at": moment("At", self._at.value),
                "strict": self._strict.value,
                "max_effort_step": not_negative("Largest step", self._step.value),
                "timeout": 2.0,
                "who": who,
            }
        except BadInput as error:
            self._reply.tell(RequestResult(False, str(error)))
            return
        self._reply.ask(topics.SWITCH_CONTROLLER, values)
