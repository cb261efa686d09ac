"""A script of a user, as mypy --strict reads it: every public name has its type."""

from typing import Any, assert_type

import numpy as np
import numpy.typing as npt

import flexslew as fs
from flexslew_lab.families import Listing


class Damper:
    """A law of ten lines."""

    def __init__(
        self, settings: dict[str, Any], period: float, effort_limit: npt.NDArray[np.float64]
    ) -> None:
        self.gain = float(settings.get("gain", 900.0))

    def update(
        self, measurement: fs.Measurement, estimate: fs.Estimate, reference: fs.Reference
    ) -> npt.NDArray[np.float64]:
        """Return the efforts [N m]."""
        return self.gain * (reference.velocity - measurement.joint_velocity)


def test_a_script_with_types_runs() -> None:
    trial = fs.trial("m1", {"duration": 0.2, "plan": None}, law=Damper)
    assert_type(trial, fs.Trial)
    flight = fs.fly(trial)
    assert_type(flight, fs.Flight)
    assert_type(flight.time, npt.NDArray[np.float64])
    assert_type(flight.signals["position.base_yaw"], npt.NDArray[np.float64])
    assert_type(flight.names("position"), tuple[str, ...])
    assert_type(flight.units("position"), tuple[str, ...])
    assert_type(flight.units["energy"], str)
    assert_type(fs.laws(), Listing)
    assert_type(fs.laws()["lqr"], str)
    bench = fs.bench(trial)
    assert_type(bench, fs.Bench)
    question = bench.question
    assert_type(question, fs.Measurement)
    effort = -900.0 * question.joint_velocity
    bench.offer(fs.EffortCommand(question.tick, question.epoch, question.controller, effort))
    bench.advance()
    found = fs.sweep(trial, {"testbed.modes": [1, 2]})
    assert_type(found, fs.Sweep)
    assert found["ticks"].shape == (2,)
    assert list(flight.names) == list(flight.units) == list(flight)
