"""Disturbance minimisation with a linear quadratic regulator (Kwak 1989, (3-1) to (3-10)).

f = -(B*)^+ d(t) - R^-1 B^T P x: the first part is the plan's (method retargeting, feedforward
disturbance_minimisation), which includes d(t); the gains are those of the start configuration.
"""

import numpy as np

from flexslew_control.controllers.entry import LawEntry, PlanVariant
from flexslew_control.controllers.retargeting.sampled_regulator import Design, sampled_gain
from flexslew_control.controllers.retargeting.small_motion_laws import StateFeedback, state_form
from flexslew_control.estimators.small_motion_observer import ObserverSettings, observer
from flexslew_control.law import Estimator, PlantDescription
from flexslew_control.linear.design_checks import require_controllable
from flexslew_control.linear.small_motion import design_motion
from flexslew_control.shared_keys import WholeModel
from flexslew_plant.settings import Positive, section


@section
class RegulatorWeights:
    """Q and R of the regulator, in the units of the testbed's section."""

    state: Positive = 100.0  # weight on every coordinate and rate
    effort: Positive = 0.001  # weight on every effort


@section
class DisturbanceMinimisation:
    """Linear quadratic regulator of a platform with turning antennas."""

    model: WholeModel = None
    weights: RegulatorWeights = RegulatorWeights()  # `state` and `effort` of the regulator
    # of the gains: continuous, or sampled for efforts that are held over a tick
    design: Design = "continuous"
    observer: ObserverSettings = ObserverSettings()  # noises of the estimator


def build(
    settings: DisturbanceMinimisation, plant: PlantDescription
) -> tuple[Estimator, StateFeedback]:
    """Return the estimator of small motions and the law.

    Raises:
        BadInput: a motion is not controllable or does not show in the readings, or the loop is
            not stable at this period.
    """
    motion = design_motion(plant, settings.model)
    before = motion.before()
    a, b = before.state_matrix, before.state_input_matrix
    require_controllable(a, b, (*motion.names, *(f"{name} rate" for name in motion.names)))
    w = settings.weights
    q, r = w.state * np.eye(len(a)), w.effort * np.eye(b.shape[1])
    gain = sampled_gain(a, b, q, r, plant.period, settings.design)
    return observer(motion, settings.observer, plant.period), StateFeedback(
        motion.gains(gain), motion.rest_position
    )


DISTURBANCE_MINIMISATION = LawEntry(
    "disturbance_minimisation",
    DisturbanceMinimisation,
    build,
    follows_reference=False,
    linear=state_form,
    takes_over=True,
    compared={"design": "sampled"},
    plans=(PlanVariant("", {"feedforward": "disturbance_minimisation"}),),
)
