"""A trajectory of others, shaped before it is flown."""

from flexslew_control.plan import Plan
from flexslew_control.planners.entry import PlanTask
from flexslew_control.planners.input_shaping.section import InputShaping, ShapedBy
from flexslew_control.planners.input_shaping.shaped_modes import modes_along
from flexslew_control.planners.joint_trajectory import (
    checked_points,
    motion_along,
    plan_of_motion,
)
from flexslew_control.planners.slew import require_effort, slew_of
from flexslew_plant.errors import BadInput


def plan_shaped_trajectory(task: PlanTask) -> Plan:
    """Return the plan of a trajectory convolved with the impulses of a shaper.

    q_d(t) = sum A_i q_r(t - t_i), of positions, rates and efforts of every joint; an attitude is
    convolved as its rotation vector.

    Raises:
        BadInput: points that are not allowed, see joint_trajectory; or keys of a slew beside them.
        ExcessTorque: negative impulses need more effort than a drive has.
    """
    settings: InputShaping = task.settings
    slew = slew_of(settings, task.plant, task.feedback)
    if isinstance(settings.trajectory, str) or settings.trajectory is None:
        words = "give its points; a file is read where the trial is read"
        raise BadInput(words, "plan", "trajectory", settings.trajectory)
    points, names = checked_points(settings.trajectory, slew, "trajectory")
    feedforward = any(any(point.effort.values()) for point in points) or task.feedback is None
    shaped = ShapedBy.of(settings, modes_along(slew, feedforward, settings.damping))
    if not shaped.modes:
        words = "the model has no mode to shape; give frequencies, or method: joint_trajectory"
        raise BadInput(words, "plan", "frequencies", [])
    motion = motion_along(points, names, slew, settings.start, shaped.shaper)
    words = (
        "the shaped trajectory needs {:.4g} on {}, the limit is {:g}; give a slower one, or "
        "negative: false"
    )
    require_effort(motion.peak, slew.effort_limit, slew.model.joint_names, words)
    return plan_of_motion(settings, slew, motion, shaped.summary)
