"""The joint gains of a law, which planners take into account."""

from flexslew_control.allocation import joint_gains
from flexslew_control.controllers import CONTROLLERS, law_values
from flexslew_control.law import ActiveLaw, PlantDescription
from flexslew_control.planners.slew import Feedback
from flexslew_plant.settings import validated


def law_gains(law: ActiveLaw | None, plant: PlantDescription, source: str) -> Feedback | None:
    """Return the gains of a law by joint; None: it has no such gains, or is not known.

    Args:
        law: of the controller that flies the plan.
        plant: what stands on the bench.
        source: of the settings, for an error.

    Raises:
        BadInput: the settings are not those of the law.
    """
    if law is None or law.law not in CONTROLLERS:
        return None
    settings = validated(CONTROLLERS[law.law].settings, law_values(dict(law.settings)), source)
    settings = getattr(settings, "base", None) or settings  # a policy adds to these gains
    kp, kd = getattr(settings, "kp", None), getattr(settings, "kd", None)
    if kp is None or kd is None:
        return None
    allocation, attitude = getattr(settings, "allocation", None), plant.testbed.model().attitude
    if attitude is not None:
        kp, kd = (
            joint_gains(allocation, f"{source}.{key}", gains, attitude.axes)
            for key, gains in (("kp", kp), ("kd", kd))
        )
    return Feedback(kp=kp, kd=kd)
