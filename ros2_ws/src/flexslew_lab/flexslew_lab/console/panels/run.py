"""The header: what the bench does, start, pause, step, rate, reset, brake, help."""

import html
import re
import shlex
from collections.abc import Callable
from functools import partial
from pathlib import Path

from flexslew_lab.console.desk import Act, PanelContext, ReplyLine
from flexslew_lab.console.forms import one_of
from flexslew_lab.console.gui import Element
from flexslew_lab.console.link import BenchLink, RequestResult
from flexslew_lab.console.panels.cards import switch_request
from flexslew_lab.console.view import BenchView
from flexslew_plant.errors import BadInput
from flexslew_plant.graph import topics

FINISHED = "finished"
_LIVE = ("waiting", "running", "paused")
_RATES = {"0.1": 0.1, "0.5": 0.5, "1": 1.0, "2": 2.0, "5": 5.0, "10": 10.0, "fast": 0.0}


class HeaderPanel:
    """The state of the bench, its transport, and the emergency stop with the space bar.

    Args:
        context: of the page.
        live: there is something to operate.
    """

    def __init__(self, context: PanelContext, live: bool) -> None:
        gui, self._view = context.gui, context.view
        self._context, self._live, self._name = context, live, trial_name(context.link)
        with gui.header:
            self._brake = gui.add("brake", "Brake (space bar)", color="negative")
            self._release = gui.button("Release the brake", color="blue-grey-8")
            self._line = gui.html()
            with gui.add("row", visible=live) as self._transport:
                self._start = gui.button("Start", key="p", hint="start, or pause")
                self._pause = gui.button("Pause", key="p", hint="start, or pause", visible=False)
                self._ticks = gui.number("Ticks", 100.0, step=1.0, hint="how many a step flies")
                step = gui.button("Step", key=".", hint="fly some ticks of a paused bench")
                self._rate = gui.choice("Rate", tuple(_RATES), value="1")
                question = "Return to tick 0? What was flown stays in the log."
                reset = gui.add("confirm", "Reset", key="r", hint=question, color="blue-grey-8")
            more = {"1 to 9": "switch to the first, second, ... controller"} if live else {}
            gui.add("help", "?", key="?", hint="keys of this page", data=more)
            self._reply = ReplyLine(context)
            self._notice = gui.html()
            self._choices = gui.add("row", visible=False)
        self._offered: tuple[str, ...] = ()
        self._last_rate: float | None = None  # that the bench has reported
        self._brake.visible, self._release.visible = live, False
        acts: tuple[tuple[Element, Act], ...] = (
            (self._brake, partial(self._latch, True)),
            (self._release, partial(self._latch, False)),
            (self._start, partial(self._operate, topics.START, self._is_started)),
            (self._pause, partial(self._operate, topics.PAUSE, self._is_paused)),
            (step, self._step),
            (reset, partial(self._operate, topics.RESET, lambda: False)),
        )
        for element, act in acts:
            context.click(element, act)
        context.change(self._rate, self._set_rate)

    def refresh(self) -> None:
        """Show the run state; offer a release or a controller where the bench lacks one."""
        now = self._view.now
        words, choose = notice(self._view) if self._live else ("", False)
        self._notice.visible = bool(words)
        self._notice.content = f'<div role="status" class="bench-notice">{words}</div>'
        ready = [c.name for c in self._view.controllers.values() if c.ready]
        self._offer(tuple(sorted(ready)) if choose else ())
        operated = self._live and now.state != FINISHED
        self._release.visible = operated and self._view.brake_on_next
        self._brake.enabled = now.state != FINISHED
        self._transport.visible = operated
        # two buttons: a second click on "Pause" must not start the bench again
        self._pause.visible = self._is_started()
        self._start.visible = not self._pause.visible
        if now.state in _LIVE and now.rate_factor != self._last_rate:
            self._last_rate = now.rate_factor
            known = {rate: text for text, rate in _RATES.items()}
            self._rate.value = known.get(now.rate_factor, self._rate.value)
        self._line.content = _state_line(self._view, self._name)

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
        self._reply.ask(
            topics.SWITCH_CONTROLLER,
            switch_request(name, who),
            done=lambda: self._view.now.active == name,
        )

    def _latch(self, on: bool, who: str) -> None:
        action = topics.BRAKE if on else topics.RELEASE_BRAKE
        self._operate(action, lambda: self._view.brake_on_next == on, who)

    def _is_started(self) -> bool:
        return self._view.now.state in ("waiting", "running")

    def _is_paused(self) -> bool:
        return self._view.now.state == "paused"

    def _operate(self, action: str, done: Callable[[], bool], who: str) -> None:
        self._reply.ask(topics.OPERATE, {"action": action, "who": who}, done=done)

    def _step(self, who: str) -> None:
        ticks = self._ticks.value
        if ticks != ticks // 1 or not 1 <= ticks < 2**32:
            words = f"Ticks: {ticks:g} is not allowed: a whole number from 1"
            self._reply.tell(RequestResult(False, words))
            return
        values = {"ticks": int(ticks), "who": who}
        self._reply.ask(topics.STEP, values, done=lambda: False)

    def _set_rate(self, who: str) -> None:
        try:
            rate = one_of("Rate", self._rate.value, _RATES)
        except BadInput as error:
            self._reply.tell(RequestResult(False, str(error)))
            return
        values = {"rate_factor": rate, "who": who}
        self._reply.ask(topics.SET_RATE, values, done=lambda: self._view.now.rate_factor == rate)


def notice(view: BenchView) -> tuple[str, bool]:
    """Return the notice of a bench that no controller works, and whether one can be chosen."""
    now, request, switch = view.now, view.brake_request, view.switch_request
    if now.state not in _LIVE:
        return "", False
    if now.waiting_for:
        return f"Waiting for {html.escape(', '.join(now.waiting_for))}.", False
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


def trial_name(link: BenchLink) -> str:
    """Return the name of the trial as far as its command or its folder gives it; else nothing."""
    words = shlex.split(link.command)
    if words[1:2] == ["trial"]:
        return Path(words[2]).stem if words[2:] else ""
    return re.sub(r"-\d{8}-\d{6}$", "", Path(link.folder).name)


def _state_line(view: BenchView, name: str) -> str:
    """Return the state of the bench as HTML: a part that is empty is left out."""
    now, joints = view.now, view.joints
    tick = max(now.tick, round(view.time / joints.period)) if joints else now.tick
    end = f" of {now.last_tick}" if now.last_tick else ""
    parts = [
        ("testbed", joints.kind if joints else ""),
        (f"state {now.state.split(':')[0]}", now.state),
        ("time", f"{view.time:.2f} s"),
        ("tick", f"tick {tick}{end}"),
        ("rate", f"rate {now.rate_factor:g}" if now.rate_factor else "fast"),
        ("missed", f"{now.missed_ticks} missed" if now.missed_ticks else ""),
        ("active", now.active or "no controller"),
    ]
    spans = [f'<span class="{c}">{html.escape(text)}</span>' for c, text in parts if text]
    head = f'<h1 class="trial">{html.escape(name or "flexslew")}</h1>'
    return f'<div id="bench-state" aria-label="state of the bench">{" ".join([head, *spans])}</div>'
