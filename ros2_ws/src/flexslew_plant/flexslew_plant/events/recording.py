"""Events of the recording of a run."""

from flexslew_plant.events.event import Level, Text, fact


@fact("recording", Level.INFO, "recording into {folder}")
class RecordingStarted:
    """A recorder writes."""

    folder: Text = ""


@fact("recording_stopped", Level.FAULT, "{reason}")
class RecordingEnded:
    """A recorder can write no more; the run goes on."""

    reason: Text = ""  # for people


@fact(
    "recorder_lost",
    Level.FAULT,
    "heartbeat of the recorder {recorder} lost; later data may be missing",
)
class RecorderLost:
    """A recorder has fallen silent."""

    recorder: Text = ""


@fact("recorder_back", Level.WARNING, "the recorder {recorder} is back")
class RecorderActive:
    """A recorder that had fallen silent is back."""

    recorder: Text = ""
