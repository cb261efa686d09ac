"""A short flight whose log is written again with another content, its checksums right."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.recording.bag_writer import BagWriter
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import parse_trial
from flexslew_plant.errors import BadInput, RunFault

Message = tuple[str, bytes, int]  # topic, content, stamp
TRIAL = """
name: crafted
duration: 0.05
plan: {method: reference_only, goal: {base_yaw: 1.0e-5, hub_pitch: 0.0}, duration: 0.03}
controllers: {pd_feedforward: {}}
"""


def one_line(action: Callable[[], Any]) -> bool:
    """Return whether the action accepts its input; if it refuses, then in one line."""
    try:
        action()
    except (BadInput, RunFault) as error:
        said = str(error)
    else:
        return True
    assert len(said.splitlines()) == 1
    return False


def plain(message: Any) -> dict[str, Any]:
    return {
        name: plain(value) if hasattr(value, "__dict__") else value
        for name, value in vars(message).items()
    }


def flown(folder: Path) -> list[Message]:
    """Fly the trial into a folder."""
    run_trial(parse_trial(TRIAL, "test"), "test", folder, in_process=True, report=False)
    return [(m.topic, m.data, m.stamp) for m in BagReader(folder / "bag").messages()]


def written(folder: Path, messages: list[Message], metadata: dict[str, str]) -> Path:
    writer = BagWriter(folder, {"trial": TRIAL, "versions": "{}", **metadata})
    for topic, data, stamp in messages:
        writer.write(topic, TOPICS[topic].type, data, stamp)
    writer.close({"wall_time": "1.0"})
    return folder
