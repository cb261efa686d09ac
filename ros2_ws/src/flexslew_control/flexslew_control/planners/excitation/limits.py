"""The largest amplitude of an excitation within the limits of drives, joints and tips."""

from typing import NamedTuple

import numpy as np

from flexslew_control.controllers.sampled_loop import LinearPlant, collocated_loop
from flexslew_control.law import per_joint
from flexslew_control.planners.excitation.section import Excitation
from flexslew_control.planners.slew import Slew
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput

_USED = 0.99  # of the room: small motions leave out what is not linear
_UNSTABLE = 1e12  # of a unit excitation: a loop that is not stable


class PredictedPeaks(NamedTuple):
    """The largest values that an excitation reaches in the small motions of the model."""

    effort: Vector  # with the feedback, (joints,) [N m or N]
    excursion: Vector  # of the joints, (joints,) [rad or m]
    tip: float  # [m]


def scale_to_limits(
    settings: Excitation, slew: Slew, effort: Matrix
) -> tuple[Matrix, PredictedPeaks]:
    """Return efforts scaled to the largest that keep the limits of a section, and what they reach.

    Args:
        settings: the section.
        slew: the rest, the model that is believed and the feedback that flies it.
        effort: of the feedforward in any size, shape (ticks, joints) [N m or N].

    Raises:
        BadInput: under this feedback the small motions grow without bound.
    """
    found = _predicted(slew, effort)
    names, key = slew.model.joint_names, "plan: largest_excursion"
    excursion = per_joint(key, settings.largest_excursion, names)
    used = max(
        float((found.effort / (settings.effort_share * slew.effort_limit)).max()),
        float((found.excursion / excursion).max()),
        found.tip / settings.largest_tip if settings.largest_tip else 0.0,
    )
    if not used < _UNSTABLE:
        raise BadInput(
            f"plan: feedback: kp {slew.kp.tolist()} and kd {slew.kd.tolist()} do not hold the "
            "testbed, so no amplitude keeps within limits; give plan.feedback the gains of a "
            "controller that flies it, or an amplitude"
        )
    scale = _USED / used
    return scale * effort, PredictedPeaks(
        scale * found.effort, scale * found.excursion, scale * found.tip
    )


def _predicted(slew: Slew, effort: Matrix) -> PredictedPeaks:
    """Return the largest values of z+ = F z + G u under u = effort - kp position - kd rate."""
    rest = slew.model.rest(slew.named(slew.start))
    plant = LinearPlant(slew.model, rest)
    closed = collocated_loop(plant, slew.kp, slew.kd, slew.period)
    inputs = effort @ plant.step(slew.period)[1].T
    states = np.empty((len(effort) + 1, len(closed)))
    states[0] = 0.0
    with np.errstate(over="ignore", invalid="ignore"):
        for k, push in enumerate(inputs):
            np.dot(closed, states[k], out=states[k + 1])
            states[k + 1] += push
        position, rate = states @ plant.position.T, states @ plant.velocity.T
        total = effort - slew.kp * position[:-1] - slew.kd * rate[:-1]
        n = slew.model.coordinates
        tips = states[:, :n] @ plant.tip[:, :n].T  # deflections alone: no rates
    return PredictedPeaks(
        np.abs(total).max(axis=0),
        np.abs(position).max(axis=0),
        float(np.abs(tips).max(initial=0.0)),
    )
