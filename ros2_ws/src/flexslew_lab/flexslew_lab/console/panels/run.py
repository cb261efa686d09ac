"""Start, pause, step, reset, rate, and the brake."""

import html
from functools import partial

from flexslew_lab.console.desk import PanelContext, ReplyLine
from flexslew_lab.console.forms import one_of
from flexslew_lab.console.link import RequestResult
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
        self._brake.visible, self._release.visible = brake, False
        for element, action in (
            (self._brake, topics.BRAKE),
            (self._release, topics.RELEASE_BRAKE),
        ):
            context.click(element, partial(self._act, action))

    def refresh(self) -> None:
        """Show the run state; offer a release only if the brake is latched."""
        now = self._view.now
        self._release.visible = now.brake_latched
        self._brake.enabled = now.state != FINISHED
        words = [now.state, f"{self._view.time:.2f} s", now.active or "the drive's brake"]
        words += ["BRAKE LATCHED"] * now.brake_latched
        self._line.content = f'<span id="bench-line">{html.escape(" · ".join(words))}</span>'

    def _act(self, action: str, who: str) -> None:
        self._reply.ask(topics.OPERATE, {"action": action, "who": who})


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
        self._reply.ask(topics.OPERATE, {"action": action, "who": who})

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
        self._reply.ask(topics.SET_RATE, {"rate_factor": rate, "who": who})
