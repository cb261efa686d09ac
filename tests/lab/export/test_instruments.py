"""Gyros, star trackers and other sensors with a memory read in C what they read on the bench."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest

from flexslew_lab.export.compiled import CompiledModule, compilers
from flexslew_lab.export.flight_vector import plant_vector
from flexslew_lab.export.plant_module import noise_free, plant_module
from flexslew_lab.trial.sources import read_trial
from flexslew_lab.trial.trial import Trial, bench_settings
from flexslew_plant.arrays import Vector
from flexslew_plant.bench.bench import Bench
from flexslew_plant.testbeds.spacecraft.settings import AnySensor

GYRO = {
    "kind": "gyro", "bias": [0.01, -0.02, 0.03], "scale": [0.01, 0.0, -0.02], "bias_spread": 1e-3,
    "misalignment": [0.01, 0.02, 0.0], "angle_random_walk": 1e-4, "rate_random_walk": 1e-4,
}  # fmt: skip
TRACKER = {
    "kind": "star_tracker", "boresight": [0.0, -1.0, 0.5], "across": 1e-4, "about": 1e-3,
    "rate_noise": 1e-2, "dropout": 0.3, "blind": [[1.0, 1.5]],
}  # fmt: skip
SUN = {"kind": "sun_sensor", "sun": [1.0, 0.2, 0.3], "half_angle": 2.0, "noise": 1e-3}
FELT = {"kind": "accelerometer", "place": [0.5, 0.0, 0.2], "noise": 1e-3, "bias": 0.1}
MOST = {
    "gyro": GYRO,
    "tracker": {**TRACKER, "interval": 0.06, "delay": 0.1},
    "sun": SUN,
    "felt": FELT,
    "speeds": {"kind": "tachometer", "noise": 0.1},
}
GIMBALS = {"gyro": GYRO, "angles": {"kind": "resolver", "noise": 1e-3}}
STILL = "plan={method: none, goal: {axis: [1.0, 1.0, 0.5], angle: 20 deg}}"
CASES = {
    "wheels": ("detumble", MOST, ()),
    "a tick late": ("detumble", {"tracker": {**TRACKER, "delay": 0.02, "rate_limit": 0.04}}, ()),
    "gyros": ("control_moment_gyros", GIMBALS, (STILL,)),
}


def _trial(name: str, sensors: dict[str, Any], more: tuple[str, ...] = ()) -> Trial:
    given = [f"testbed.sensors={json.dumps(sensors)}", "duration=6.0", *more]
    return read_trial(name, given)[0]


@pytest.mark.skipif(not compilers(), reason="no C compiler is here: gcc or clang")
@pytest.mark.parametrize("case", CASES)
def test_instruments_read_the_same_tick_by_tick(case: str, tmp_path: Path) -> None:
    trial = _trial(*CASES[case])
    module = plant_module(trial)
    compiled = CompiledModule(module, tmp_path)
    vector = plant_vector(trial, module, None, case)
    found = np.array([compiled.step(row) for row in vector.inputs])
    assert len(found) == len(vector.outputs) > 200
    assert vector.error(found) < 1e-12


def _tips(trial: Trial, seed: int) -> Vector:
    bench = Bench(replace(bench_settings(trial), seed=seed))
    readings = []
    for _ in range(20):
        readings.append(bench.question.tip_deflection)
        bench.advance()
    return np.concatenate(readings)


def test_a_noise_free_trial_reads_the_same_with_every_seed() -> None:
    """A key of noise that is not left out would show."""
    noisy = _trial("detumble", MOST)
    assert (_tips(noisy, 1) != _tips(noisy, 2)).any()
    np.testing.assert_array_equal(_tips(noise_free(noisy), 1), _tips(noise_free(noisy), 2))
    seen = {one["kind"] for one in (*MOST.values(), *GIMBALS.values())}
    kinds = {kind for one in get_args(get_args(AnySensor)[0]) for kind in get_args(_kinds(one))}
    assert kinds - seen <= {"displacement", "rate", "strain"}  # as the accelerometer


def _kinds(settings: type) -> Any:
    """Return the kinds of a section of sensors."""
    return get_type_hints(settings)["kind"]
