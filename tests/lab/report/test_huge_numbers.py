"""A truth of numbers that are finite and no more: every reader says something."""

from pathlib import Path

import numpy as np
import pytest

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.messages.cdr import decode, encode
from flexslew_lab.log.recording.bag_writer import BagWriter
from flexslew_lab.report.report import write_report
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import parse_trial

TRIAL = "duration: 0.3\nplan: {method: none, goal: {base_yaw: 0.01}, duration: 0.2}\n"


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("honest")
    run_trial(parse_trial(TRIAL, "test"), "test", folder / "run", True, False)
    return folder / "run" / "bag"


@pytest.mark.filterwarnings("ignore:overflow", "ignore:invalid value")
@pytest.mark.parametrize("field", ["position", "velocity", "tip_deflection", "applied_effort"])
@pytest.mark.parametrize("size", [1e308, -1e200])
def test_a_report_is_written(honest: Path, tmp_path: Path, field: str, size: float) -> None:
    reader = BagReader(honest)
    with BagWriter(tmp_path / "bag", reader.metadata) as writer:
        for topic, kind, stamp, _, data in reader.messages():
            if topic == "/truth":
                message = vars(decode(kind, data))
                if message["tick"] > 5:
                    message[field] = np.full_like(message[field], size * (-1) ** message["tick"])
                data = encode(TOPICS[topic].type, message)
            writer.write(topic, kind, data, stamp)
        writer.close({"messages": str(writer.messages)})
    logs = [BagReader(tmp_path / "bag"), BagReader(honest)]
    write_report(logs[:1], tmp_path / "one.html")
    write_report(logs, tmp_path / "two.html")
    assert "<html" in (tmp_path / "two.html").read_text()
