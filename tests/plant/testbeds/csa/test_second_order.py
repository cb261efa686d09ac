"""What both variants leave out, of second order in the deflection, at the rates of m1."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from tests.plant.testbeds.spacecraft.crafts import csa_hub, fly
from tests.present import present

from flexslew_lab.reproduce.scole_flights import example_trial
from flexslew_lab.trial.trial import plan_of_trial
from flexslew_plant.arrays import Matrix
from flexslew_plant.testbeds.csa import CsaVariant
from flexslew_plant.testbeds.csa.testbed import CsaTestbed
from flexslew_plant.testbeds.spacecraft.assembly.craft import (
    Spacecraft,
    SpacecraftActuator,
)
from flexslew_plant.testbeds.spacecraft.assembly.packing import packed
from flexslew_plant.testbeds.spacecraft.equations import layout as at


def craft(testbed: CsaTestbed, second_order: bool) -> Spacecraft:
    """Return the same as a spacecraft: the base pivots about z, the hub is hinged about y."""
    yaw = np.array([0.0, 0.0, 1.0])
    hub = csa_hub(testbed, np.array([0.0, 1.0, 0.0]), second_order)
    base = np.diag([1.0, 1.0, testbed.parameters.base_inertia])
    drives = (
        SpacecraftActuator("base_yaw", at.TORQUE, -1, yaw),
        SpacecraftActuator("hub_pitch", at.HINGE, 0),
    )
    return Spacecraft(1.0, np.zeros(3), base, (hub,), (), drives, at.PIVOT, yaw, np.zeros(3))


@cache
def flown(variant: CsaVariant, second_order: bool) -> tuple[Matrix, Matrix, float]:
    """Return tip deflections of m1's efforts in open loop and the largest yaw rate.

    Args:
        variant: that flies them first.
        second_order: whether the same as a spacecraft, which flies them next, has such terms.
    """
    trial = example_trial("m1")
    plan = present(plan_of_trial(trial))
    assert isinstance(trial.testbed, CsaTestbed)
    model = replace(trial.testbed, variant=variant).model()
    n = model.coordinates
    start = dict(zip(model.joint_names, plan.position[0].tolist(), strict=True))
    x = np.concatenate((model.rest(start), np.zeros(n)))
    p, y = packed(craft(trial.testbed, second_order)), x.copy()
    tip, own, fastest = [], [], 0.0
    for effort in plan.effort:
        x = model.advance(x, effort, plan.period)
        y = fly(p, 0.0, y, effort, n, plan.period, 1)
        tip.append(x[2:n].sum())
        own.append(y[2:n].sum())
        fastest = max(fastest, abs(float(x[n])))
    return np.array(tip), np.array(own), fastest


@pytest.mark.slow
def test_complete_has_every_term_of_first_order() -> None:
    complete, own, _ = flown("complete", False)
    np.testing.assert_allclose(complete, own, atol=1e-9 * abs(complete).max())


@pytest.mark.slow
@pytest.mark.parametrize(("variant", "stated"), [("complete", 0.022), ("printed", 0.0124)])
def test_the_error_of_a_variant_at_the_rates_of_m1_is_the_stated_one(
    variant: CsaVariant, stated: float
) -> None:
    bench, whole, rate = flown(variant, True)
    assert rate == pytest.approx(0.051, rel=0.01)
    assert abs(bench - whole).max() / abs(whole).max() == pytest.approx(stated, rel=0.05)
