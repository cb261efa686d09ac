from typing import Any

import numpy as np
import pytest
from tests.plants import plant as on_bench

from flexslew_control.controllers import build_controller
from flexslew_control.controllers.by_joint.collocated_pid import CollocatedPid, build
from flexslew_control.controllers.sampled_loop import integral_loop
from flexslew_control.law import PlantDescription, Reference
from flexslew_control.plan import Plan
from flexslew_lab.reproduce import laws as reproduce_laws
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import Measurement
from flexslew_plant.testbeds import read_testbed
from flexslew_plant.testbeds.csa import CsaTestbed


def held(_tick: Any) -> Reference:
    return Reference(np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(0))


def test_a_constant_disturbance_leaves_no_error() -> None:
    controller = build(CollocatedPid(), on_bench())
    run = reproduce_laws.closed_loop(
        CsaTestbed(modes=1, damping_ratio=0.01), controller, held, 300.0, disturbance=5.0
    )
    assert abs(run.state[-1, 0]) < 1e-4
    assert abs(run.state[:, 0]).max() < 2.0 * 5.0 / 460.0


def test_the_default_gains_are_stable_at_every_pitch_up_to_one_radian() -> None:
    model = CsaTestbed(modes=1).model()
    gains = [getattr(CollocatedPid(), name)[0] for name in ("kp", "kd", "ki")]
    for pitch in np.linspace(0.0, 1.0, 6):
        linear = model.linearise(np.array([0.0, pitch, 0.0]))
        kp, kd, ki = (gain * linear.input_matrix.T for gain in gains)
        loop = integral_loop(linear, kp, kd, ki, None)
        assert np.linalg.eigvals(loop).real.max() < 0.0


def test_too_much_integral_is_refused_with_the_eigenvalue() -> None:
    with pytest.raises(BadInput, match=r"not stable: eigenvalue 0\.\d+"):
        build(CollocatedPid(ki=(500.0, 15.0)), on_bench())


def test_three_gains_for_two_joints_are_refused() -> None:
    with pytest.raises(BadInput, match=r"kp: .* give 1 or 2 numbers \(base_yaw, hub_pitch\)"):
        build(CollocatedPid(kp=(460.0, 460.0, 460.0)), on_bench())


def test_effort_stays_within_the_limit_and_the_integral_unwinds() -> None:
    def far(_tick: Any) -> Reference:
        return Reference(np.array([1.0, 0.0]), np.zeros(2), np.zeros(2), np.zeros(0))

    testbed = CsaTestbed(modes=1, damping_ratio=0.01)
    overshoot = {}
    for time in (None, 10.0):
        controller = build(CollocatedPid(tracking_time=time), on_bench(limit=(50.0, 50.0)))
        run = reproduce_laws.closed_loop(testbed, controller, far, 100.0)
        assert abs(run.effort).max() <= 50.0
        overshoot[time] = run.state[:, 0].max() - 1.0
    assert overshoot[10.0] < overshoot[None]


def craft(axis: list[float]) -> PlantDescription:
    """Return a rigid craft with four wheels, one of them along this axis."""
    axes = (axis, [0.0, 1.0, 0.3], [0.1, 0.0, 1.0], [0.6, 0.6, 0.5])
    wheels = {
        f"wheel_{k}": {"axis": each, "inertia": 0.02, "limit": 0.5} for k, each in enumerate(axes)
    }
    values = {
        "kind": "spacecraft", "platform": {"inertia": {"xx": 10.0, "yy": 14.0, "zz": 18.0}},
        "appendages": {}, "actuators": {}, "wheels": wheels,
    }  # fmt: skip
    return PlantDescription(read_testbed(values, "here"), 0.1, np.full(4, 0.5))


def test_in_three_axes_it_shares_out_among_the_drives_that_it_believes_in() -> None:
    """It knows the turn, as the bench reads it; the torque that a wheel gives it believes."""
    true, thought = [1.0, 0.2, 0.0], [1.0, 0.0, 0.1]
    given = {"kp": [4.0], "kd": [9.0], "ki": [0.1], "allocation": {"kind": "wheels"}}
    believes = given | {"model": {"wheels": {"wheel_0": {"axis": thought}}}}
    bench, rng, none = craft(true), np.random.default_rng(0), np.zeros(0)
    axes = bench.testbed.model().attitude
    assert axes is not None
    turn, rate = 0.01 * rng.standard_normal((2, 3))
    torque = -4.0 * turn - 9.0 * rate
    seen = Measurement(0, 0, 0.0, "it", axes.axes @ turn, axes.axes @ rate, none, none, np.zeros(4))
    for settings, believed in ((given, true), (believes, thought)):
        it = build_controller("it", "collocated_pid", settings, bench, "here")
        plan = Plan("none", bench.joint_names, 0.0, 0.1, np.zeros((2, 4)), np.zeros((2, 4)),
                    np.zeros((1, 4)), np.zeros((2, 0)), 0.1)  # fmt: skip
        assert it.adopt(plan) is None
        answer = it.observe(seen)
        assert answer is not None
        there = craft(believed).testbed.model().attitude
        assert there is not None
        np.testing.assert_allclose(there.axes.T @ answer.command.effort, torque, rtol=1e-9)
