"""Margins: at each one a pole of the loop with that gain or delay is on the unit circle."""

from dataclasses import replace
from functools import cache
from typing import Any

import control
import ctrlsys
import numpy as np
import pytest
from tests.plants import plant
from tests.representatives import products

from flexslew_control.analysis.linear_plant import PlantPath, sampled_plant
from flexslew_control.analysis.loop import ControlLoop, loop_of, visible_poles
from flexslew_control.analysis.loop_margins import (
    ChannelMargins,
    LoopFrequencyResponse,
    _scaled,
    best_scaling,
    channel_margins,
    disk_margins,
    frequency_response,
    mu_bounds,
    peaks,
)
from flexslew_control.analysis.lti import Lti
from flexslew_control.analysis.rest import rest_of
from flexslew_control.controllers import build_controller
from flexslew_control.controllers.probing.running_law import running_law
from flexslew_control.linear.zero_order_hold import zero_order_hold
from flexslew_plant.hardware.actuator import ActuatorSettings
from flexslew_plant.testbeds import read_testbed

BEDS = {
    "csa, 0": ({"kind": "csa"}, {}),
    "csa, .5": ({"kind": "csa", "modes": 2}, {"hub_pitch": 0.5}),
    "csa, 1": ({"kind": "csa", "damping_ratio": 0.01}, {"hub_pitch": 1.0}),
    "hub": ({"kind": "hub_with_appendages", "damping_ratio": 0.01}, {}),
    "oscillator": ({"kind": "floating_oscillator", "damping_ratio": 0.01}, {}),
}
LAWS: dict[str, dict[str, Any]] = {
    "pd_feedforward": {},
    "collocated_pid": {},
    "output_feedback": {"model": {"modes": 1}},
    "lqr": {"filter": {"modal_noise": 1e-3}},
}
SOFT = {"pd_feedforward": {"kp": [0.5], "kd": [1.0]},
        "collocated_pid": {"kp": [0.5], "kd": [1.0], "ki": [0.02]}}  # fmt: skip
LATE = ActuatorSettings(lag=0.2)
PATHS = {"ideal": ActuatorSettings(), "lag": ActuatorSettings(lag=0.05)}


@cache
def at_rest(bed: str, law: str) -> tuple[Any, Any]:
    """Return the rest, and the law as it answers there, whatever drive is between the two."""
    values, joints = BEDS[bed]
    testbed = read_testbed(values, "here")
    described = plant(0.01, testbed.effort_limit, testbed)
    settings = LAWS[law] if bed.startswith("csa") else {**LAWS[law], **SOFT.get(law, {})}
    it = build_controller("it", law, settings, described, "here")
    rest = rest_of(testbed, joints)
    return rest, running_law(it, rest, described.effort_limit).form


def loop(bed: str, law: str, path: PlantPath) -> tuple[Any, Any, ControlLoop]:
    rest, form = at_rest(bed, law)
    return rest, form, loop_of(sampled_plant(rest, path, applied=True), form)


def radius(rest: Any, form: Any, path: PlantPath) -> float:
    poles, _ = visible_poles(loop_of(sampled_plant(rest, path, applied=True), form))
    return float(abs(poles).max())


@pytest.mark.parametrize(("bed", "law", "actuator"), products(BEDS, LAWS, PATHS))
def test_just_inside_of_a_margin_the_loop_is_stable_and_just_outside_it_is_not(
    bed: str, law: str, actuator: str
) -> None:
    path = PlantPath(0.01, PATHS[actuator])
    rest, form, found = loop(bed, law, path)
    if radius(rest, form, path) >= 1.0:
        assert (law, actuator) != ("pd_feedforward", "ideal")
        return  # there is nothing to be kept
    sweep, m = frequency_response(found), found.efforts
    for k, name in enumerate(found.effort_names):
        margins, one = channel_margins(sweep, name), np.eye(m)[k]
        assert margins.gain_down < 1.0 < margins.gain_up
        if margins.gain_up < 1e6:
            inside, outside = (1.0 + (margins.gain_up * f - 1.0) * one for f in (0.999, 1.001))
            assert radius(rest, form, replace(path, gain=inside)) < 1.0
            assert radius(rest, form, replace(path, gain=outside)) > 1.0
        if margins.gain_down > 1e-3:
            inside, outside = (1.0 + (margins.gain_down * f - 1.0) * one for f in (1.001, 0.999))
            assert radius(rest, form, replace(path, gain=inside)) < 1.0
            assert radius(rest, form, replace(path, gain=outside)) > 1.0
        if margins.delay < 1.0:
            ticks = margins.delay / 0.01
            assert radius(rest, form, replace(path, delay=0.999 * ticks * one)) < 1.0
            assert radius(rest, form, replace(path, delay=1.001 * ticks * one)) > 1.0


def test_a_loop_of_one_channel_has_python_control_s_disk_margin_and_peaks() -> None:
    _, _, found = loop("hub", "pd_feedforward", PlantPath(0.01))
    sweep = frequency_response(found)
    disk = disk_margins(sweep, found.effort_names)
    system = found.opened(found.effort_names).state_space()
    theirs = control.disk_margins(system, sweep.grid)
    assert disk.alpha == pytest.approx(theirs[0], rel=1e-6)
    assert 20.0 * np.log10(disk.gain) == pytest.approx(theirs[1], rel=1e-6)
    assert np.degrees(disk.phase) == pytest.approx(theirs[2], rel=1e-6)
    s, _ = peaks(sweep, found.effort_names)
    sensitivity = control.feedback(control.ss([], [], [], [[1.0]], 0.01), system)
    assert s == pytest.approx(abs(sensitivity(np.exp(1j * sweep.grid * 0.01))).max(), rel=1e-6)


def test_the_bound_of_mu_is_slicot_s() -> None:
    rng = np.random.default_rng(9)
    for size in (2, 3, 5):
        m = rng.standard_normal((20, size, size)) + 1j * rng.standard_normal((20, size, size))
        for one, osborne in zip(m, mu_bounds(m), strict=True):
            ones = np.ones(size, dtype=np.int32)
            bound = ctrlsys.ab13md(np.asfortranarray(one), ones, 2 * ones)[0]
            value = _scaled(one, best_scaling(one))
            # ours minimises a norm that is within log(size) / 2000 of the bound, theirs iterates
            assert value == pytest.approx(bound, rel=1e-3)
            assert bound * (1.0 - 1e-6) <= value <= osborne * (1.0 + 1e-6)


def test_a_disk_margin_keeps_every_gain_and_phase_inside_of_it() -> None:
    rest, form, found = loop("csa, .5", "pd_feedforward", PlantPath(0.01))
    disk = disk_margins(frequency_response(found), found.effort_names)
    rng = np.random.default_rng(3)
    for _ in range(40):
        gain = disk.gain ** rng.uniform(-0.999, 0.999, 2)
        assert radius(rest, form, PlantPath(0.01, gain=gain)) < 1.0


def held_joint(
    stiffness: float, kp: float, kd: float, ki: float
) -> tuple[LoopFrequencyResponse, ChannelMargins]:
    """Return the loop of q'' + stiffness q = u under a sampled PID, and its margins at the effort.

    The integral is of the position before the tick.
    """
    period, effort, read = 0.01, ("effort.it",), ("position.it", "rate.it")
    f, g = zero_order_hold(
        np.array([[0.0, 1.0], [-stiffness, 0.0]]), np.array([[0.0], [1.0]]), period
    )
    bench = Lti(f, g, np.eye(2), np.zeros((2, 1)), effort, read, ("q", "v"), period)
    one = np.ones((1, 1))
    law = Lti(one, np.array([[-period * ki, 0.0]]), one, np.array([[-kp, -kd]]), read, effort,
              ("s",), period)  # fmt: skip
    sweep = frequency_response(loop_of(bench, law))
    return sweep, channel_margins(sweep, "effort.it")


@pytest.mark.parametrize("bandwidth", [1.0, 0.02, 1e-3])
def test_a_loop_that_is_slow_beside_its_ticks_has_the_margins_of_the_continuous_one(
    bandwidth: float,
) -> None:
    kp, kd, ki = bandwidth**2, 1.4 * bandwidth, 0.1 * bandwidth**3
    sweep, found = held_joint(0.0, kp, kd, ki)
    # L = (kd s^2 + kp s + ki) / s^3; the rest is by the hold, half a tick
    w = np.geomspace(0.01, 100.0, 200_001) * bandwidth
    gain = (kd * (1j * w) ** 2 + kp * 1j * w + ki) / (1j * w) ** 3
    over = int(np.argmin(abs(abs(gain) - 1.0)))
    close = 2e-4 + 0.02 * bandwidth
    assert found.phase == pytest.approx(np.angle(-gain[over]), rel=close)
    assert found.crossovers == pytest.approx([w[over]], rel=close)
    assert found.delay == pytest.approx(np.angle(-gain[over]) / w[over], rel=close)
    assert found.gain_down == pytest.approx(ki / (kp * kd), rel=close)  # Hurwitz
    worst = abs(1.0 / (1.0 + gain) - 0.5).max()
    assert disk_margins(sweep, ("effort.it",)).alpha == pytest.approx(1.0 / worst, rel=2.0 * close)


@pytest.mark.parametrize("fall", [1e-4, 0.1])
def test_a_gain_that_holds_a_falling_joint_no_more_is_a_margin_at_zero_frequency(
    fall: float,
) -> None:
    found = held_joint(-fall, 4.0 * fall, np.sqrt(fall), 0.0)[1]
    assert found.gain_down == pytest.approx(0.25, rel=1e-6)
    assert found.down_frequency == 0.0


@pytest.mark.parametrize("coupling", [0.02, 1e-3, 1e-4])
def test_the_delay_margin_of_a_mode_that_is_seen_weakly_is_found(coupling: float) -> None:
    # L is beyond one on a band as narrow as the coupling squared, beside which a grid is coarse
    mode = {"frequency": 8.6, "joints": [coupling], "tips": [1.0]}
    bed = {"kind": "identified", "inertia": [[100.0]], "free_modes": [mode]}
    testbed = read_testbed(bed, "here")
    described = plant(0.1, testbed.effort_limit, testbed)
    gains = {"kp": [4.0], "kd": [34.0], "ki": [0.08]}
    it, rest = build_controller("it", "collocated_pid", gains, described, "h"), rest_of(testbed)
    form, path = running_law(it, rest, described.effort_limit).form, PlantPath(0.1, LATE)
    found = loop_of(sampled_plant(rest, path, applied=True), form)
    margins = channel_margins(frequency_response(found), "effort.hub")
    late = np.array([margins.delay / 0.1])
    for share in np.linspace(0.05, 0.99, 12):
        assert radius(rest, form, replace(path, delay=share * late)) < 1.0
    assert radius(rest, form, replace(path, delay=1.01 * late)) > 1.0
