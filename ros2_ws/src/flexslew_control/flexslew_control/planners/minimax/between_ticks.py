"""How far members pass the limits of their path, between the ticks too.

The programs look at the ticks. What the motors gave over each of them is known from the flight, so
the states inside it follow from the same equations of motion.
"""

from dataclasses import replace

import numpy as np

from flexslew_control.planners.minimax.successive import EnsembleProblem
from flexslew_plant.arrays import Vector

_PARTS = 4  # of a tick; states are checked at their ends


def passed(ensemble: EnsembleProblem, weights: Vector) -> float:
    """Return the largest share by which a member passes a limit of its path; none: zero or less.

    The limits are those of rates and of what the motion reads along the path, with nothing spared:
    inside every tick of the slew, and at the ticks after it.

    Args:
        ensemble: the members.
        weights: of the efforts.
    """
    limits, motion = ensemble.question.limits, ensemble.question.motion
    period = ensemble.grid.period / _PARTS
    if not limits.of_path:
        return 0.0
    trajectories = ensemble.simulate(weights)
    excess = -np.inf
    for member, flight, response in zip(
        ensemble.members, trajectories, ensemble.fixed(weights, trajectories), strict=True
    ):
        model, first = member.model, response.tips + 2 * response.goal.size
        low, high, size = (part[first:] for part in replace(limits, margin=0.0).of(response.tips))
        states = model.path(flight.states[0], np.repeat(flight.applied, _PARTS, axis=0), period)
        rates = states @ motion.outputs(model)[first - response.goal.size :].T
        read = np.hstack((rates, motion.along(states)))
        read = np.vstack((read, response.later(response.path.end[1])[:, first:]))
        excess = max(excess, float((np.maximum(low - read, read - high) / size).max()))
    return excess
