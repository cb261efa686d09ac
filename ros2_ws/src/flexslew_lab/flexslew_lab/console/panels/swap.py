"""Give the bench to another controller."""

from math import isfinite

from flexslew_lab.console.desk import Desk, Reply
from flexslew_lab.console.link import Told
from flexslew_plant import topics

_NOBODY = "(nobody there)"


class SwapPanel:
    """A list of controllers, and when and how to switch.

    Args:
        desk: of the page.
    """

    def __init__(self, desk: Desk) -> None:
        gui = desk.gui
        self._view = desk.view
        self._who = gui.add_dropdown("Controller", (_NOBODY,))
        self._at = gui.add_number("At [s]", 0.0, hint="simulated time; 0: the next tick")
        self._strict = gui.add_checkbox("Strict", False, hint="refuse a larger step of the effort")
        self._step = gui.add_number("Largest step", 1.0, hint="of the effort [N m or N]")
        desk.click(gui.add_button("Switch"), self._switch)
        self._reply = Reply(desk)

    def refresh(self) -> None:
        """List who is on the graph."""
        names = tuple(sorted(self._view.controllers)) or (_NOBODY,)
        if names != tuple(self._who.options):
            self._who.options = names

    def _switch(self, who: str) -> None:
        for label, field in (("At", self._at), ("Largest step", self._step)):
            if not (isfinite(field.value) and 0.0 <= field.value < 1e9):
                words = f"{label}: {field.value} is not allowed: at least 0, below 1e9"
                self._reply.tell(Told(False, words))
                return
        values = {
            "controller": self._who.value,
            "at": self._at.value,
            "strict": self._strict.value,
            "max_effort_step": self._step.value,
            "timeout": 2.0,
            "who": who,
        }
        self._reply.ask(topics.SWITCH_CONTROLLER, values)
