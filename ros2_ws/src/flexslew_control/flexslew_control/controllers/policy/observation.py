"""What a policy observes at a tick, and the efforts that its action stands for.

One definition for the law that flies a network, for an environment, and, compiled, for many
members at once.
"""

import numpy as np

from flexslew_control.law import Estimate, Reference
from flexslew_plant.arrays import Vector
from flexslew_plant.measurement import Measurement
from flexslew_plant.testbeds.model import Model


def observed_signals(model: Model) -> tuple[str, ...]:
    """Return the names of the entries of an observation, in their order.

    Instruments of a craft, as a gyro, are no tips: an estimator reads them.
    """
    joints = model.joint_names
    tips = model.appendages.names if model.appendages.all_tips else ()
    of = {"error": joints, "error_rate": joints, "tip": tips, "applied": joints,
          "feedforward": joints}  # fmt: skip
    return tuple(f"{kind}.{name}" for kind, names in of.items() for name in names)


def observation(
    measurement: Measurement, estimate: Estimate, reference: Reference, limit: Vector, tips: int
) -> Vector:
    """Return what a policy observes, shape (4 joints + tips,).

    Args:
        measurement: of this tick.
        estimate: of the joints, q and q'.
        reference: of this tick, q_d and q_d', and the plan's effort.
        limit: of the drives, shape (joints,) [N m or N].
        tips: how many are observed.

    Returns:
        q_d - q [rad or m], q_d' - q' [rad/s or m/s], the tips [m], the effort applied during the
        last tick and the plan's effort, both as shares of the limits.
    """
    m = limit.size
    return np.concatenate(
        (
            reference.position - estimate.position[:m],
            reference.velocity - estimate.velocity[:m],
            measurement.tip_deflection[:tips],
            measurement.applied_effort / limit,
            reference.effort / limit,
        )
    )
