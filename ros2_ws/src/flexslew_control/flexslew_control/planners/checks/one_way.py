"""Plans for thrusters, which push one way: their torque is shared out as the law will share it."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from flexslew_control.allocation import Allocator, allocator_of
from flexslew_control.controllers import CONTROLLERS, law_values
from flexslew_control.law import ActiveLaw, PlantDescription
from flexslew_control.plan import Plan
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.settings import validated

_ROUNDING = 1e-9  # of a limit or of the largest torque


class Shared(NamedTuple):
    """A plan with its torque shared out among the drives."""

    plan: Plan
    used: float  # largest share of what the drives can give; above 1: too much [-]


def shared_out(plan: Plan, plant: PlantDescription, law: ActiveLaw | None) -> Shared:
    """Return a plan with the efforts by which the law's own allocation gives its torques.

    A plan for all drives counts them both ways. Where some are thrusters, the torque T of each
    tick is given by those that the law uses, and no push is negative. Without thrusters the plan
    stays as it is.

    Args:
        plan: for all joints of the bench.
        plant: what stands on the bench.
        law: that will fly it; None: not known.

    Raises:
        BadInput: there are thrusters, and the law does not share a torque out.
    """
    model, limit = plant.testbed.model(), plant.effort_limit
    if not model.one_way or not plan.effort.any():
        return Shared(plan, float((abs(plan.effort).max(axis=0, initial=0.0) / limit).max()))
    allocator = _allocator(plant, law)
    torques = plan.effort @ allocator.torque.T
    effort = np.array([allocator.shares(torque) for torque in torques])
    size, given = (np.linalg.norm(t, axis=1) for t in (torques, effort @ allocator.torque.T))
    active = size > _ROUNDING * size.max()
    excess = float((size[active] / given[active]).max(initial=0.0))
    used = float((abs(effort).max(axis=0) / limit).max())
    peak = abs(effort).max(axis=0).tolist()
    return Shared(
        replace(plan, effort=effort, summary={**plan.summary, "peak_effort": peak}),
        max(used, excess) if excess > 1.0 + _ROUNDING else used,
    )


def _allocator(plant: PlantDescription, law: ActiveLaw | None) -> Allocator:
    allocation = None
    if law is not None and law.law in CONTROLLERS:
        settings = validated(CONTROLLERS[law.law].settings, law_values(dict(law.settings)), "plan")
        allocation = getattr(settings, "allocation", None)
    if allocation is None:
        raise BadInput(
            f"{plant.joint_names[plant.testbed.model().one_way[0]]} is a thruster, which pushes "
            "one way; give the active controller an `allocation`, which selects what turns the "
            "craft",
            key="plan",
        )
    return allocator_of(allocation, plant)


def require_one_way(plan: Plan, plant: PlantDescription) -> None:
    """Check that a plan demands no pull from a thruster.

    Raises:
        PlanFailed: if it does.
    """
    for k in plant.testbed.model().one_way:
        least = float(plan.effort[:, k].min(initial=0.0))
        if least < -_ROUNDING * plant.effort_limit[k]:
            raise PlanFailed(
                f"{plant.joint_names[k]} is a thruster, which pushes one way, and {plan.method} "
                f"asks it for {least:.3g} N; move this craft by forces, torques or wheels, or turn "
                "it in three axes with an `allocation`"
            )
