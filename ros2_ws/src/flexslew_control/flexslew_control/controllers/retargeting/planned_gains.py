"""PI control with gains that change with time, as the plan has computed them (Kwak 1989, (3-52)).

The plan (method retargeting, gains perturbation or adiabatic) holds a row of gains for each tick;
the tick itself computes none.
"""

from flexslew_control.controllers.entry import LawEntry, PlanVariant
from flexslew_control.controllers.retargeting.disturbance_accommodating import (
    IntegralWeights,
    integral_gains,
)
from flexslew_control.controllers.retargeting.small_motion_laws import (
    IntegralFeedback,
    integral_form,
)
from flexslew_control.estimators.small_motion_observer import ObserverSettings, observer
from flexslew_control.law import Estimator, PlantDescription
from flexslew_control.linear.small_motion import design_motion
from flexslew_control.shared_keys import TrackingTime, WholeModel
from flexslew_plant.settings import section


@section
class PlannedGains:
    """PI control with gains that change along the plan, as antennas turn."""

    model: WholeModel = None
    # of the gains before the plan gives others, as for disturbance_accommodating
    weights: IntegralWeights = IntegralWeights()
    observer: ObserverSettings = ObserverSettings()  # noises of the estimator
    tracking_time: TrackingTime = 10.0


def build(settings: PlannedGains, plant: PlantDescription) -> tuple[Estimator, IntegralFeedback]:
    """Return the estimator of small motions and the law.

    Raises:
        BadInput: a motion is not controllable or does not show in the readings.
    """
    motion = design_motion(plant, settings.model)
    gains = motion.gains(integral_gains(motion.before(), settings.weights))
    law = IntegralFeedback(
        gains,
        motion.rest_position,
        plant.effort_limit,
        settings.tracking_time,
        plant.period,
        planned=True,
    )
    return observer(motion, settings.observer, plant.period), law


PLANNED_GAINS = LawEntry(
    "planned_gains",
    PlannedGains,
    build,
    follows_reference=False,
    linear=integral_form,
    plans=tuple(
        PlanVariant(gains, {"gains": gains}) for gains in ("constant", "perturbation", "adiabatic")
    ),
)
