"""Events of the recording of a run."""

from typing import ClassVar

from flexslew_plant.events.event import Level, Text, fact


@fact
class RecordingStarted:
    """A recorder writes."""

    kind: ClassVar[str] = "recording"
    level: ClassVar[Level] = Level.INFO
    folder: Text = ""

    @property
    def message(self) -> str:
        """One line for a person."""
        return f"recording into {self.folder}"


@fact
class RecordingEnded:
    """A recorder can write no more; the run goes on."""

    kind: ClassVar[str] = "recording_stopped"
    level: ClassVar[Level] = Level.FAULT
    reason: Text = ""  # for people

    @property
    def message(self) -> str:
        """One line for a person."""
        return self.reason


@fact
class RecorderLost:
    """A recorder has fallen silent."""

    kind: ClassVar[str] = "recorder_lost"
    level: ClassVar[Level] = Level.FAULT
    recorder: Text = ""

    @property
    def message(self) -> str:
        """One line for a person."""
        return f"heartbeat of the recorder {self.recorder} lost; later data may be missing"


@fact
class RecorderBack:
    """A recorder that had fallen silent is back."""

    kind: ClassVar[str] = "recorder_back"
    level: ClassVar[Level] = Level.WARNING
    recorder: Text = ""

    @property
    def message(self) -> str:
        """One line for a person."""
        return f"the recorder {self.recorder} is back"
