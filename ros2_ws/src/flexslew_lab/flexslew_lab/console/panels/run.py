"""Start, pause, step, reset, rate, and the brake."""

from functools import partial

from flexslew_lab.console.desk import Desk, Reply
from flexslew_lab.console.forms import one_of
from flexslew_lab.console.link import RequestResult
from flexslew_plant import topics
from flexslew_plant.errors import BadInput

_RATES = {"0.1": 0.1, "0.5": 0.5, "1": 1.0, "2": 2.0, "5": 5.0, "10": 10.0, "fast": 0.0}


class BrakePanel:
    """The emergency stop, with the space bar.

    Args:
        desk: of the page.
    """

    def __init__(self, desk: Desk) -> None:
        gui, self._view = desk.gui, desk.view
        self._brake = gui.add_button("Brake (space bar)", color="red")
        self._release = gui.add_button("Release the brake", color="gray")
        key = gui.add_command("Brake", description="Emergency stop", hotkey="space")
        self._reply = Reply(desk)
        for element, action in (
            (self._brake, topics.BRAKE),
            (key, topics.BRAKE),
            (self._release, topics.RELEASE_BRAKE),
        ):
            desk.click(element, partial(self._act, action))

    def refresh(self) -> None:
        """Offer to release only what is latched."""
        if self._release.visible != self._view.now.brake_latched:
            self._release.visible = self._view.now.brake_latched

    def _act(self, action: str, who: str) -> None:
        self._reply.ask(topics.OPERATE, {"action": action, "who": who})


class RunPanel:
    """The run.

    Args:
        desk: of the page.
    """

    def __init__(self, desk: Desk) -> None:
        gui = desk.gui
        self._view = desk.view
        for name, action in (("Start", topics.START), ("Pause", topics.PAUSE)):
            desk.click(gui.add_button(name), partial(self._act, action))
        # a float: what a page sends is made one, and an integer of any size would stop every page
        self._ticks = gui.add_number("Ticks", 100.0, step=1.0, hint="how many a step flies")
        desk.click(gui.add_button("Step"), self._step)
        self._rate = gui.add_dropdown("Rate", tuple(_RATES), initial_value="1")
        desk.click(gui.add_button("Set the rate"), self._set_rate)
        self._reply = Reply(desk)
        with gui.add_folder("Back to tick 0"):  # away from Pause: it ends what is flown
            desk.click(gui.add_button("Reset", color="gray"), partial(self._act, topics.RESET))

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
