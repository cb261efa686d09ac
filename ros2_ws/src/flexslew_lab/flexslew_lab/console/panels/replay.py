"""Move through a log: play, pause, a rate, a time slider."""

from typing import Protocol

from flexslew_lab.console.desk import PanelContext, ReplyLine
from flexslew_lab.console.forms import one_of
from flexslew_lab.console.link import RequestResult
from flexslew_plant.errors import BadInput

_RATES = {"0.1": 0.1, "0.5": 0.5, "1": 1.0, "2": 2.0, "5": 5.0, "10": 10.0, "50": 50.0}


class RecordingPanel(Protocol):
    """A log that plays."""

    first: float  # time of its first message in the log [s]
    last: float  # and of its last one [s]
    time: float  # and of what is shown; simulated, but after a reset it goes on [s]

    @property
    def playing(self) -> bool:
        """Time passes."""

    def seek(self, time: float) -> RequestResult:
        """Go to a time of the log [s]."""

    def play(self, rate: float) -> None:
        """Go on from here, simulated seconds per wall second; 0: rest."""


class ReplayPanel:
    """The controls of a log.

    Args:
        context: of the page.
        recording: that is shown.
    """

    def __init__(self, context: PanelContext, recording: RecordingPanel) -> None:
        gui = context.gui
        self._recording = recording
        end = max(recording.last, recording.first + 0.01)
        self._time = gui.slider("Time [s]", recording.first, end, 0.01, recording.first)
        self._goal = gui.number("Go to [s]", recording.first)
        self._rate = gui.choice("Rate", tuple(_RATES), value="1")
        self._toggle = gui.button("Play", key="p", hint="play, or pause")
        context.click(self._toggle, self._play_or_pause)
        self._reply = ReplyLine(context)
        context.change(self._time, lambda who: self._seek(self._time.value))
        context.change(self._goal, lambda who: self._seek(self._goal.value))

    def refresh(self) -> None:
        """Let the slider follow."""
        self._toggle.label = "Pause" if self._recording.playing else "Play"
        if self._recording.playing and abs(self._time.value - self._recording.time) >= 0.1:
            self._time.value = self._recording.time

    def _play_or_pause(self, who: str) -> None:
        if self._recording.playing:
            self._recording.play(0.0)
            return
        try:
            self._recording.play(one_of("Rate", self._rate.value, _RATES))
        except BadInput as error:
            self._reply.tell(RequestResult(False, str(error)))

    def _seek(self, time: float) -> None:
        """Go to a time; one that is no number, as of an empty field, is none to go to."""
        if time == time:
            self._reply.tell(self._recording.seek(time))
            self._time.value = min(max(self._recording.time, self._time.low), self._time.high)
