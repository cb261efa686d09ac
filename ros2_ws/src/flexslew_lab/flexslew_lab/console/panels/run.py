"""Start, pause, step, reset, rate, the brake, and what a bench without a controller needs."""

import html
from functools import partial

from flexslew_lab.console.desk import PanelContext, ReplyLine
from flexslew_lab.console.forms import one_of
from flexslew_lab.console.link import RequestResult
from flexslew_lab.console.panels.swap import switch_request
from flexslew_lab.console.view import BenchView
from flexslew_plant.errors import BadInput
from flexslew_plant.graph import topics

FINISHED = "finished"
_RATES = {"0.1": 0.1, "0.5": 0.5, "1": 1.0, "2": 2.0, "5": 5.0, "10": 10.0, "fast": 0.0}


class HeaderPanel:
    """One line on the bench, always in sight, and the emergency stop with the space bar.

    Args:
        context: of the page.
        brake: there is something to stop.
    """

    def __init__(self, context: PanelContext, brake: bool) -> None:
        self._view = context.view
        with context.gui.header:
            self._brake = context.gui.add("brake", "Brake (space bar)", color="negative")
            self._release = context.gui.button("Release the brake", color="blue-grey-8")
            self._line = context.gui.html()
            self._reply = ReplyLine(context)
            self._notice = context.gui.html()
            self._choices = context.gui.add("row", visible=False)
        self._context, self._live = context, brake
        self._offered: tuple[str, ...] = ()
        self._brake.visible, self._release.visible = brake, False
        for element, action in (
            (self._brake, topics.BRAKE),
            (self._release, topics.RELEASE_BRAKE),
        ):
            context.click(element, partial(self._act, action))

    def refresh(self) -> None:
        """Show the run state; offer a release or a controller where the bench lacks one."""
        now = self._view.now
        words, choose = notice(self._view) if self._live else ("", False)
        self._notice.visible = bool(words)
        self._notice.content = f'<div role="status" class="bench-notice">{words}</div>'
        ready = [c.name for c in self._view.controllers.values() if c.ready]
        self._offer(tuple(sorted(ready)) if choose else ())
        self._release.visible = self._view.brake_on_next and now.state != FINISHED
        self._brake.enabled = now.state != FINISHED
        line = [now.state, f"{self._view.time:.2f} s", now.active or "the drive's brake"]
        self._line.content = f'<span id="bench-line">{html.escape(" · ".join(line))}</span>'

    def _offer(self, names: tuple[str, ...]) -> None:
        """Show a button for each of these controllers."""
        self._choices.visible = bool(names)
        if names == self._offered:
            return
        self._offered, self._choices.children = names, ()
        with self._choices:
            for name in names:
                button = self._context.gui.button(name, hint=f"{name} takes over at the next tick")
                self._context.click(button, partial(self._switch, name))

    def _switch(self, name: str, who: str) -> None:
        done = lambda: self._view.now.active == name  # noqa: E731
        self._reply.ask(topics.SWITCH_CONTROLLER, switch_request(name, who), done=done)

    def _act(self, action: str, who: str) -> None:
        on = action == topics.BRAKE
        done = lambda: self._view.brake_on_next == on  # noqa: E731
        self._reply.ask(topics.OPERATE, {"action": action, "who": who}, done=done)


def notice(view: BenchView) -> tuple[str, bool]:
    """Return the notice of a bench that no controller works, and whether one can be chosen."""
    now, request, switch = view.now, view.brake_request, view.switch_request
    if now.state not in ("waiting", "running", "paused"):
        return "", False
    if request is not None and request.on:
        paused = "The bench is paused: the" if now.state == "paused" else "The"
        return f"{paused} brake latches at tick {request.tick}.", False
    if view.brake_on_next and now.state == "paused":
        return "The brake is latched. After a start ticks pass under the brake.", False
    if view.brake_on_next:
        return "The brake is latched: ticks pass under the brake, no controller is active.", False
    if switch is not None and (request is not None or not now.active):
        return f"{html.escape(switch.controller)} takes over at tick {switch.tick}.", False
    if request is not None:
        return f"The brake is released at tick {request.tick}. Choose the next controller:", True
    return ("", False) if now.active else ("No controller is active; choose one:", True)


class RunPanel:
    """The run.

    Args:
        context: of the page.
    """

    def __init__(self, context: PanelContext) -> None:
        gui = context.gui
        self._view = context.view
        for name, action in (("Start", topics.START), ("Pause", topics.PAUSE)):
            context.click(gui.button(name), partial(self._act, action))
        self._ticks = gui.number("Ticks", 100.0, step=1.0, hint="how many a step flies")
        context.click(gui.button("Step"), self._step)
        self._rate = gui.choice("Rate", tuple(_RATES), value="1")
        context.click(gui.button("Set the rate"), self._set_rate)
        self._reply = ReplyLine(context)
        with gui.folder("Back to tick 0"):  # away from Pause: it ends what is flown
            context.click(
                gui.button("Reset", color="blue-grey-8"), partial(self._act, topics.RESET)
            )

    def refresh(self) -> None:
        """Nothing changes by itself."""

    def _act(self, action: str, who: str) -> None:
        states = {topics.START: ("waiting", "running"), topics.PAUSE: ("paused",)}
        expected = states.get(action, ())
        done = lambda: self._view.now.state in expected  # noqa: E731
        self._reply.ask(topics.OPERATE, {"action": action, "who": who}, done=done)

    def _step(self, who: str) -> None:
        ticks = self._ticks.value
        if ticks != ticks // 1 or not 1 <= ticks < 2**32:
            self._reply.tell(
                RequestResult(False, f"Ticks: {ticks:g} is not allowed: a whole number from 1")
            )
            return
        self._reply.ask(topics.STEP, {"ticks": int(ticks), "who": who})

    def _set_rate(self, who: str) -> None:
        try:
            rate = one_of("Rate", self._rate.value, _RATES)
        except BadInput as error:
            self._reply.tell(RequestResult(False, str(error)))
            return
        done = lambda: self._view.now.rate_factor == rate  # noqa: E731
        self._reply.ask(topics.SET_RATE, {"rate_factor": rate, "who": who}, done=done)
