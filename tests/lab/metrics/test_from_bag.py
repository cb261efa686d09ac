"""Metrics against the closed form of the synthetic run."""

import hashlib
import json
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.messages.cdr import decode, encode
from flexslew_lab.metrics import KEYS
from flexslew_lab.metrics.from_bag import metrics_of
from flexslew_lab.metrics.momentum import Momentum
from flexslew_lab.metrics.plant_timing import PlantTiming
from flexslew_lab.metrics.platform.jitter import Jitter
from flexslew_lab.metrics.platform.keep_out import KeepOutMetric
from flexslew_lab.metrics.platform.line_of_sight import LineOfSightMetric
from flexslew_lab.metrics.platform.performance_errors import PerformanceErrors
from flexslew_lab.metrics.platform.platform_error import PlatformError
from flexslew_lab.metrics.platform.pointing import PointingMetric
from flexslew_lab.metrics.tip_deflection import TipDeflection
from flexslew_lab.metrics.trajectory import TrajectoryHash
from flexslew_lab.metrics.vibration import Vibration
from flexslew_plant.errors import BadInput

Message = tuple[str, bytes, int]


def test_the_keys_are_those_of_the_schema(bag: Path) -> None:
    metrics = metrics_of(bag)
    of_others = (  # platforms that point, external plants
        PointingMetric, PlatformError, PerformanceErrors, Jitter, Momentum, KeepOutMetric,
        LineOfSightMetric, Vibration, PlantTiming,
    )  # fmt: skip
    elsewhere = {key for kind in of_others for key in kind.KEYS} - set(TipDeflection.KEYS)
    assert [key for key in KEYS if key not in elsewhere] == list(metrics)
    json.dumps(metrics, allow_nan=False)
    for key, value in metrics.items():
        assert isinstance(value, dict) == KEYS[key].per_joint


def test_values_are_those_of_the_closed_form(bag: Path) -> None:
    m = metrics_of(bag)
    t = np.arange(501) * 0.01
    tip = np.abs(0.3 * np.sin(2.0 * t))
    assert m["residual_tip_deflection"] == pytest.approx(tip[t >= 2.0 - 1e-9].max(), rel=1e-12)
    assert m["residual_attitude_error"] == pytest.approx({"base_yaw": 0.0, "hub_pitch": 0.0})
    assert m["final_error"] == pytest.approx({"base_yaw": 0.0, "hub_pitch": 0.0})
    s = t / 2.0
    outside = t[np.abs(3 * s**2 - 2 * s**3 - 1) * (t < 2.0) > 0.02][-1]
    assert m["settling_time"] == pytest.approx({"base_yaw": outside, "hub_pitch": outside})
    assert m["overshoot"] == pytest.approx({"base_yaw": 0.0, "hub_pitch": 0.0})
    assert m["peak_effort"] == {"base_yaw": 40.0, "hub_pitch": 20.0}
    assert m["control_effort"] == pytest.approx(0.5 * 1600 + 4.5 * 100 + 5.0 * 400)
    assert m["rms_effort"]["hub_pitch"] == pytest.approx(20.0)
    assert m["saturated_time"] == pytest.approx(0.5)
    end = np.array([0.3 * np.sin(4.0), 0.6 * np.cos(4.0)])
    assert m["terminal_error_norm"] == pytest.approx(np.linalg.norm(end))
    assert (m["ticks"], m["missed_ticks"], m["switches"]) == (500, 1, 1)
    assert m["largest_effort_step"] == 0.5
    assert (m["wall_time"], m["missing_ticks"], m["log_complete"]) == (1.25, 0, True)


def test_the_hash_is_sha256_of_ticks_and_states(bag: Path) -> None:
    digest, ours = hashlib.sha256(), TrajectoryHash()
    for _, _, m in BagReader(bag).decode_messages(["/truth"]):
        digest.update(struct.pack("<Q", m.tick))
        digest.update(struct.pack("<4d", *m.position) + struct.pack("<4d", *m.velocity))
        ours.update(m.tick, m.position, m.velocity)
    assert metrics_of(bag)["trajectory_hash"] == digest.hexdigest() == ours.hexdigest()


def test_ticks_that_the_log_skips_are_counted(
    tmp_path: Path, messages: list[Message], write_bag: Callable[..., Path]
) -> None:
    kind = TOPICS["/truth"].type
    some = [m for m in messages if not (m[0] == "/truth" and 200 <= decode(kind, m[1]).tick < 207)]
    metrics = metrics_of(write_bag(tmp_path / "run", some))
    assert (metrics["missing_ticks"], metrics["ticks"]) == (7, 500)


def test_after_a_reset_the_last_epoch_counts(
    tmp_path: Path, messages: list[Message], write_bag: Callable[..., Path]
) -> None:
    kind = TOPICS["/truth"].type
    again = []
    for topic, data, stamp in messages[:500]:
        if topic == "/truth":
            m = decode(kind, data)
            m.epoch = 1
            again.append((topic, encode(kind, m), stamp))
    metrics = metrics_of(write_bag(tmp_path / "run", [*messages, *again]))
    assert metrics["ticks"] == len(again) - 1
    assert metrics["missed_ticks"] == 0


def test_a_cut_log_says_so(tmp_path: Path, write_bag: Callable[..., Path]) -> None:
    folder = write_bag(tmp_path / "run")
    file = next(folder.glob("*.mcap"))
    data = file.read_bytes()
    file.write_bytes(data[: len(data) // 2])
    metrics = metrics_of(file)
    assert metrics["log_complete"] is False
    assert 0 < metrics["ticks"] < 500


def test_a_bag_without_truth_has_nothing_to_measure(
    tmp_path: Path, messages: list[Message], write_bag: Callable[..., Path]
) -> None:
    folder = write_bag(tmp_path / "run", [m for m in messages if m[0] != "/truth"])
    with pytest.raises(BadInput, match="holds no truth"):
        metrics_of(folder)
