"""What an experiment has found turns about one of its joints as its whole equations do."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from flexslew_control.law import PlantDescription
from flexslew_control.planners.attitude.one_axis import OneAxis, reduced
from flexslew_control.planners.slew import Feedback
from flexslew_lab.trial.sources import read_trial
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import plain
from flexslew_plant.testbeds.contract import Turning
from flexslew_plant.testbeds.identified import FreeMode, IdentifiedTestbed


def drawn(rng: np.random.Generator) -> IdentifiedTestbed:
    """Return a bench of three joints and four modes."""
    root = rng.standard_normal((3, 3))
    inertia = root @ root.T + 3.0 * np.eye(3)
    modes = tuple(
        FreeMode(
            frequency=float(w),
            joints=tuple((0.2 * rng.standard_normal(3)).tolist()),
            tips=tuple(rng.standard_normal(2).tolist()),
        )
        for w in np.sort(rng.uniform(0.5, 9.0, 4))
    )
    return IdentifiedTestbed(
        joints=("a", "b", "c"),
        joint_units=("rad", "rad", "m"),
        inertia=tuple(map(tuple, (0.5 * (inertia + inertia.T)).tolist())),
        free_modes=modes,
        modes=4,
        appendages=("left", "right"),
        effort_limit=(1.0, 2.0, 3.0),
    )


def response(testbed: Any, w: float, held: list[int], joint: int) -> Any:
    """Return joint and tips per unit of effort at w with the other joints held."""
    linear = testbed.model().linearise(testbed.model().rest({}))
    kept = [k for k in range(len(linear.mass)) if k not in held]
    part = (linear.stiffness - w**2 * linear.mass)[np.ix_(kept, kept)]
    push = np.zeros(len(kept))
    push[kept.index(joint)] = 1.0
    x = np.linalg.solve(part, push)
    m = testbed.model().joints
    return np.append(
        x[kept.index(joint)], testbed.model().appendages.tip @ x[-(len(kept) - 1) :]
    ), m


@pytest.mark.parametrize("seed", range(5))
def test_a_turn_about_one_joint_answers_as_the_whole_with_the_others_held(seed: int) -> None:
    rng = np.random.default_rng(seed)
    whole = drawn(rng)
    assert isinstance(whole, Turning)
    alone = whole.turning("b")
    for w in rng.uniform(0.2, 12.0, 10):
        ours, joints = response(alone, w, [], 0)
        assert joints == 1
        assert ours == pytest.approx(response(whole, w, [0, 2], 1)[0], rel=1e-6, abs=1e-9)
    assert whole.turning("b", 2).modes == 2
    assert alone.effort_limit == (2.0,)


def test_the_efforts_of_a_rigid_turn_move_one_joint_alone() -> None:
    whole = drawn(np.random.default_rng(9))
    turn = whole.rigid_turn("c")
    rate = np.linalg.solve(np.array(whole.inertia), turn.tangential)
    assert rate == pytest.approx([0.0, 0.0, 1.0], abs=1e-12)
    assert turn.inertia == whole.inertia[2][2]
    with pytest.raises(BadInput, match="has no joint d; it has a, b, c"):
        whole.turning("d")


def test_a_spacecraft_is_planned_on_what_was_identified_and_told_what_cannot_be() -> None:
    trial, _ = read_trial("own_spacecraft", None)
    found = IdentifiedTestbed(
        joints=("roll",),
        inertia=((60.0,),),
        free_modes=(FreeMode(frequency=7.0, joints=(0.05,), tips=(1.0, -1.0)),),
        appendages=("left", "right"),
        effort_limit=(0.5,),
    )

    section: Any = trial.plan

    def about(model: Any) -> Any:
        return replace(section, model=model)

    plant = PlantDescription(trial.testbed, trial.period, np.array(trial.testbed.effort_limit))
    feedback = Feedback(kp=(12.0,), kd=(60.0,))
    turn = reduced(about(plain(found)), plant, feedback)
    assert isinstance(turn, OneAxis)
    assert turn.rigid.inertia == 60.0
    assert turn.plant.testbed.model().modes == 1
    with pytest.raises(BadInput, match="hub_with_appendages"):
        reduced(about({"kind": "hub_with_appendages"}), plant, feedback)
