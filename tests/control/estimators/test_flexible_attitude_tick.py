"""The compiled tick of the filter with modes believes what AttitudeEstimator believes.

A campaign over crafts, delays, gaps, sensors and noises; the truth turns, bends and is pushed.
"""

from itertools import product
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.lab.studies.batch.both_ways import CRAFT
from tests.representatives import representatives

from flexslew_control.estimators.attitude_estimator import (
    AttitudeEstimator,
    AttitudeFilterSettings,
    attitude_estimator,
)
from flexslew_control.estimators.attitude_tick import write_joints
from flexslew_control.estimators.flexible_attitude_filter import AppendageModesSettings
from flexslew_control.estimators.flexible_attitude_tick import (
    FlexibleFilters,
    flexible_form,
    flexible_memory,
    flexible_tick,
)
from flexslew_control.law import PlantDescription, Reference
from flexslew_plant.arrays import EMPTY, Matrix
from flexslew_plant.measurement import Measurement
from flexslew_plant.testbeds import read_testbed
from flexslew_plant.testbeds.compiled.batch_kernel import BATCH_WIDTH
from flexslew_plant.testbeds.compiled.scalar_kernel import scalar_kernel
from flexslew_plant.testbeds.instruments import BodyState
from flexslew_plant.testbeds.instruments.instrument import TickReader, channels

PERIOD, TICKS = 0.1, 120


class Flight(NamedTuple):
    """What a filter is told, tick by tick."""

    tips: Matrix
    effort: Matrix  # that was held before
    reference: Matrix


def described(rng: np.random.Generator, delays: tuple[int, ...], suns: int) -> dict[str, Any]:
    """Return any craft with two booms that three wheels turn, and its sensors."""
    noisy = rng.random() < 0.8
    sensors: dict[str, Any] = {
        "gyro": {
            "kind": "gyro", "angle_random_walk": rng.choice([2e-5, 2e-4]),
            "rate_random_walk": rng.choice([0.0, 3e-6]), "bias_spread": 1e-4 * noisy,
        }
    }  # fmt: skip
    for k, delay in enumerate(delays):
        sensors[f"tracker_{k}"] = {
            "kind": "star_tracker", "boresight": rng.standard_normal(3).tolist(), "across": 2e-5,
            "about": 1.5e-4, "rate_noise": rng.choice([0.0, 2e-3]), "delay": PERIOD * delay,
            "interval": rng.choice([0.0, 0.3]), "dropout": rng.choice([0.0, 0.3]),
            "blind": [[0.0, 0.5], [8.0, 10.0]][: rng.integers(0, 3)],
        }  # fmt: skip
    for k in range(suns):
        towards = rng.standard_normal(3).tolist()
        sensors[f"sun_{k}"] = {
            "kind": "sun_sensor", "noise": 1e-4, "half_angle": 1.8, "sun": towards
        }  # fmt: skip
    spins = np.eye(3) + 0.3 * rng.standard_normal((3, 3))
    wheels = {
        f"wheel_{k}": {"axis": (spin / np.linalg.norm(spin)).tolist(), "inertia": 0.05, "limit": 2}
        for k, spin in enumerate(spins)
    }
    size = rng.uniform(0.8, 1.2, 3) * [40.0, 35.0, 30.0]
    inertia = dict(zip(("xx", "yy", "zz"), size.tolist(), strict=True)) | {"xy": 1.0}
    platform = {"mass": rng.uniform(100.0, 200.0), "inertia": inertia}
    boom = CRAFT["appendages"]["boom"]
    axes = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    hinge = {"place": [0.3, -0.4, 0.1], "axes": axes}
    other = boom | {"hinge": hinge, "shape": boom["shape"] | {"length": 4.0, "modes": 3}}
    appendages = {"boom": boom, "other": other}
    own = {"platform": platform, "appendages": appendages, "wheels": wheels, "sensors": sensors}
    return CRAFT | own


def estimator(rng: np.random.Generator, craft: dict[str, Any]) -> AttitudeEstimator:
    """Return the filter of a craft, half of them with another mass in mind."""
    testbed = read_testbed(craft, "testbed")
    belief = {"platform": {"mass": 130.0}} if rng.random() < 0.5 else None
    settings = AttitudeFilterSettings(
        noise_factor=rng.choice([1.0, 3.0]), initial_attitude=rng.choice([1e-3, 1.0]),
        initial_bias=2e-4,
        modes=AppendageModesSettings(model=belief, effort_noise=1e-2, initial=1e-3),
    )  # fmt: skip
    plant = PlantDescription(testbed, PERIOD, np.array(testbed.effort_limit))
    return attitude_estimator(plant, settings)


def flight(rng: np.random.Generator, craft: dict[str, Any], reference: Matrix) -> Flight:
    """Return the readings of a craft by its own equations, some of them broken."""
    model = read_testbed(craft, "testbed").model()
    instruments, m = model.appendages.instruments, model.joints
    x = np.concatenate((model.rest({}), np.zeros(model.coordinates)))
    x[model.positions : model.positions + 6] = 0.1 * rng.standard_normal(6)
    readers = [TickReader(one, PERIOD, rng.spawn(1)[0]) for one in instruments]
    tips = np.zeros((TICKS, len(model.appendages.names)))
    effort, start = np.zeros((TICKS, m)), Rotation.random(random_state=rng)
    for k in range(TICKS):
        if k > 0:
            effort[k] = 0.9 * effort[k - 1] + rng.normal(0.0, 0.3, m)
            x = model.advance(x, effort[k] + rng.normal(0.0, 0.03, m), PERIOD, 6)
        position, rate = model.joint_state(x)
        assert model.attitude is not None
        turned = start * Rotation.from_quat(model.attitude.orientation(position))
        body = BodyState(turned.as_quat(), model.attitude.rotation_vector_of(rate))
        for one, read in zip(instruments, readers, strict=True):
            tips[k, channels(one)] = read(body)
            if one.name != "gyro" and rng.random() < 0.05:
                tips[k, channels(one)] = rng.choice([np.nan, 0.0])
    return Flight(tips, effort, reference)


def estimated(it: AttitudeEstimator, flown: Flight) -> Matrix:
    """Return positions and velocities of the joints that the estimator believes, (ticks, 6)."""
    rows, none = [], np.zeros(3)
    for k, (tips, effort, reference) in enumerate(zip(*flown, strict=True)):
        it.expect(Reference(reference, none, none, EMPTY))
        seen = Measurement(k, 0, k * PERIOD, "", none, none, tips, 0.0 * tips, effort)
        if k == 0:
            it.reset(seen)
        found = it.update(seen)
        rows.append(np.concatenate((found.position, found.velocity)))
    return np.array(rows)


def side_by_side(parts: list[Any]) -> Any:
    return type(parts[0])(*(np.array(each) for each in zip(*parts, strict=True)))


def ticked(crafts: list[AttitudeEstimator], flights: list[Flight]) -> Matrix:
    """Return the same of the compiled tick, (crafts, ticks, 6)."""
    sensors = [it.numbers for it in crafts]
    forms = [form for it in crafts if (form := flexible_form(it)) is not None]
    known = [form.numbers for form in forms]
    assert forms[0].steps > 1
    kernel, [steps] = scalar_kernel(forms[0].model), {form.steps for form in forms}
    count = len(crafts)
    tick = flexible_tick(kernel, steps)
    memory = np.full((count, flexible_memory(sensors[0], known[0], len(flights[0].tips.T))), 7.0)
    packed = np.array([known[min(k, count - 1)].packed for k in range(BATCH_WIDTH)]).T
    place = kernel.place(np.ascontiguousarray(packed))
    filters = FlexibleFilters(side_by_side(sensors), side_by_side(known), memory, place)
    believed, found = np.empty((count, 7)), np.empty((count, TICKS, 6))
    for k in range(TICKS):
        told = np.array([np.concatenate((one.tips[k], one.effort[k])) for one in flights])
        reference = flights[0].reference[k]
        tick(k, filters, told, reference, believed, count)
        for member in range(count):
            write_joints(
                sensors[member], believed[member], np.zeros(6), reference, found[member, k]
            )
    return found


@pytest.mark.parametrize(
    ("delays", "suns"),
    representatives(product([(0,), (1,), (0, 2)], [0, 2])),
)
def test_the_compiled_tick_believes_what_the_estimators_believe(
    delays: tuple[int, ...], suns: int
) -> None:
    rng = np.random.default_rng([suns, *delays])
    reference = np.cumsum(0.05 * rng.standard_normal((TICKS, 3)), axis=0)
    crafts = [described(rng, delays, suns) for _ in range(4)]
    estimators = [estimator(rng, one) for one in crafts]
    flights = [flight(rng, one, reference) for one in crafts]
    found = ticked(estimators, flights)
    for it, flown, ours in zip(estimators, flights, found, strict=True):
        # the belief says something: it is not the reference
        assert abs(ours[:, :3] - reference).max() > 1e-3
        np.testing.assert_allclose(ours, estimated(it, flown), rtol=1e-12, atol=1e-12)
