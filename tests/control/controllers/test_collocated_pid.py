from typing import Any

import numpy as np
import pytest
from tests.plants import plant as on_bench

from flexslew_control.controllers.collocated_pid import CollocatedPid, build, closed_loop
from flexslew_control.law import Reference
from flexslew_lab.reproduce import laws as reproduce_laws
from flexslew_plant.errors import BadInput
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
    gains = [np.full(2, getattr(CollocatedPid(), name)[0]) for name in ("kp", "ki", "kd")]
    for pitch in np.linspace(0.0, 1.0, 6):
        loop = closed_loop(model.linearise(np.array([0.0, pitch, 0.0])), *gains)
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
