"""Whether a plan begins where the joints of the bench are."""

from collections.abc import Mapping

import numpy as np

from flexslew_control.law import PlantDescription
from flexslew_control.plan import Plan, with_warning
from flexslew_plant.testbeds import initial_positions

_SAME = 1e-6  # rounding of a position, and of a rate [rad or m], [rad/s or m/s]


def with_jump(plan: Plan, plant: PlantDescription, initial: Mapping[str, float]) -> Plan:
    """Return the plan, with a warning if its reference jumps at its start.

    Args:
        plan: that begins.
        plant: what stands on the bench, its joints at rest.
        initial: positions of joints instead of those of the testbed, by name [rad or m].
    """
    model = plant.testbed.model()
    if plan.joint_names != model.joint_names:  # the node that adopts it refuses it
        return plan
    at = initial_positions(plant.testbed) | dict(initial)
    here = np.array([at[name] for name in plan.joint_names])
    offsets = [
        f"{name} by {far:.4g} {unit}"
        for far_each, per in (
            (model.joint_error(here, plan.position[0]), ""),
            (plan.velocity[0], "/s"),
        )
        for name, far, unit in zip(
            plan.joint_names,
            far_each.tolist(),
            (f"{u}{per}" for u in model.joint_units),
            strict=True,
        )
        if abs(far) > _SAME
    ]
    if not offsets:
        return plan
    words = (
        f"the reference jumps at {plan.start:g} s: {', '.join(offsets)}; begin the plan where the "
        "joints are, at rest, or set testbed.initial"
    )
    return with_warning(plan, words)
