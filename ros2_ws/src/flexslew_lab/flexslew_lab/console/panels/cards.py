"""The controllers as cards: which is active, which is ready or why not; switch, and tune."""

import html
from collections.abc import Callable
from functools import partial
from typing import Any

from flexslew_lab.console.desk import PanelContext, ReplyLine
from flexslew_lab.console.forms import moment, not_negative
from flexslew_lab.console.gui import Element
from flexslew_lab.console.link import RequestResult
from flexslew_lab.console.loop_margins import LoopMargin
from flexslew_lab.console.view import ControllerView
from flexslew_plant.errors import BadInput
from flexslew_plant.graph import topics

NO_CONTROLLER = "(none found)"
_KEYS = "123456789"  # of the first cards


class CardsPanel:
    """A card for each controller, and below them when and how to switch.

    Args:
        context: of the page.
        tune: opens the gains of a controller; None: a log, which takes no requests.
    """

    def __init__(self, context: PanelContext, tune: Callable[[str], None] | None) -> None:
        gui = context.gui
        self._context, self._view, self._tune = context, context.view, tune
        gui.html("<h2>Controllers</h2>")
        self._place = gui.add("stack")
        self._none = gui.html("no controller found")
        self._reply = ReplyLine(context)
        self._cards: dict[str, tuple[Element, Element]] = {}  # text and buttons
        with gui.add("details", "How to switch", visible=tune is not None):
            self._at = gui.number("At [s]", 0.0, hint="simulated time; 0: the next tick")
            self._strict = gui.check("Strict", False, hint="refuse a larger step of the effort")
            self._step = gui.number("Largest step [N m or N]", 1.0, hint="of the effort")

    def refresh(self) -> None:
        """Show the controllers on the graph."""
        known = self._view.controllers
        if list(self._cards) != sorted(known):
            self._place.children, self._cards = (), {}
            with self._place:
                for k, name in enumerate(sorted(known)):
                    self._cards[name] = self._card(name, _KEYS[k : k + 1])
        self._none.visible = not known
        now = self._view.now
        for name, (text, switch) in self._cards.items():
            margin = self._context.margins.of(name)
            text.content = _card_text(known[name], now.active == name, margin)
            switch.visible, switch.enabled = now.active != name, known[name].ready
            if switch.parent is not None:
                switch.parent.visible = self._tune is not None and now.state != "finished"

    def _card(self, name: str, key: str) -> tuple[Element, Element]:
        gui = self._context.gui
        with gui.add("card"):
            text = gui.html()
            with gui.add("row", visible=self._tune is not None):
                hint = f"{name} takes over, at the next tick unless another time is given below"
                switch = gui.button(f"Switch to {name}", hint=hint, key=key)
                tune = gui.button(f"Tune {name}", hint="open its gains", color="blue-grey-8")
        self._context.click(switch, partial(self._switch, name))
        self._context.click(tune, lambda who: self._tune(name) if self._tune else None)
        return text, switch

    def _switch(self, name: str, who: str) -> None:
        try:
            values = switch_request(name, who) | {
                "at": moment("At", self._at.value),
                "strict": self._strict.value,
                "max_effort_step": not_negative("Largest step", self._step.value),
            }
        except BadInput as error:
            self._reply.tell(RequestResult(False, str(error)))
            return
        was_active = False

        def holds() -> bool:  # the state of the bench may come after the answer
            nonlocal was_active
            was_active = was_active or self._view.now.active == name
            return not was_active or self._view.now.active == name

        def then(result: RequestResult) -> None:
            if result.ok:
                self._reply.tell(result, holds)

        self._reply.ask(
            topics.SWITCH_CONTROLLER, values, then, lambda: self._view.now.active == name
        )


def switch_request(name: str, who: str) -> dict[str, Any]:
    """Return the request for a switch to a controller at the next tick."""
    step = {"strict": False, "max_effort_step": 1.0}
    return {"controller": name, "at": 0.0, **step, "timeout": 2.0, "who": who}


def _card_text(controller: ControllerView, active: bool, margin: LoopMargin) -> str:
    state = "ready" if controller.ready else f"not ready: {controller.reason}"
    state, kind = ("active", "active") if active else (state, "ready" * controller.ready)
    name, law = html.escape(controller.name), html.escape(controller.law)
    law = f" <small>{law}</small>" if law != name else ""
    loop = f"<div>{html.escape(margin.words)}</div>" if margin.known else ""
    return f'<b>{name}</b>{law}<div class="{kind}">{html.escape(state)}</div>{loop}'
