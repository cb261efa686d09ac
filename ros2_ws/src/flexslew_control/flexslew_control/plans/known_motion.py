"""The motion of a bench before a plan begins, and the residual of the plan that includes it."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from flexslew_control.plan import Plan, with_warning
from flexslew_plant.arrays import Vector

PREDICTED = "predicted_residual_tip_deflection"  # key of a summary: largest tip deflection left [m]
ATTITUDE_ERROR = "predicted_residual_attitude_error"  # key: by joint [rad or m]
FROM_REST = "predicted_residual_from_rest"  # key: PREDICTED without the motion before the plan [m]
_SMALL, _SHARE = 1e-4, 0.1  # negligible motion: [m] or [rad] or per second, and of PREDICTED [-]


class KnownMotion(NamedTuple):
    """The state of a bench at a tick, as it is displayed."""

    tick: int
    joints: Mapping[str, tuple[float, float]]  # position and velocity [rad or m, per second]
    modes: Vector  # modal coordinates, shape (modes,) [m]
    rates: Vector  # of these [m/s]
    tips: Vector  # deflections, then their rates, shape (2 tips,) [m, m/s]


def is_small(size: float, plan: Plan) -> bool:
    """Return whether a deflection or rate is small next to the predicted residual of a plan."""
    return size <= _SMALL + _SHARE * float(plan.summary.get(PREDICTED) or 0.0)


def at_rest(motion: KnownMotion, plan: Plan) -> bool:
    """Return whether joints and tips move so little that the prediction from rest holds."""
    rates = [abs(rate) for _, rate in motion.joints.values()]
    return is_small(max([*rates, *abs(motion.tips).tolist()], default=0.0), plan)


def with_motion(plan: Plan, left: float, errors: Mapping[str, float], time: float) -> Plan:
    """Return the plan with its residual from a known motion, and a warning if that is larger.

    Args:
        plan: that is predicted from rest.
        left: largest tip deflection after the plan's end [m].
        errors: largest error of each joint after it [rad or m].
        time: of the known state [s].
    """
    from_rest = float(plan.summary[PREDICTED])
    values: dict[str, Any] = {PREDICTED: left, ATTITUDE_ERROR: dict(errors), FROM_REST: from_rest}
    included = replace(plan, summary={**plan.summary, **values})
    if is_small(left - from_rest, plan):
        return included
    return with_warning(
        included,
        f"the bench moves at {time:g} s: from that state the plan leaves {left:.3g} m at the tips, "
        f"from rest {from_rest:.3g} m; damp the swing first, by the law or by a later start",
    )


def with_tip_motion(plan: Plan, amplitude: float) -> Plan:
    """Return the plan with a bound of its residual that includes the tips' swing before it.

    Free vibration keeps its amplitude without damping, and the motions of a linear plant add up:
    the bound is the sum.

    Args:
        plan: that is predicted from rest; one with the residual from a known motion stays as it is.
        amplitude: largest deflection of a tip while the plan was made [m].
    """
    from_rest = plan.summary.get(PREDICTED)
    if from_rest is None or FROM_REST in plan.summary or is_small(amplitude, plan):
        return plan
    bound = from_rest + amplitude
    included = replace(plan, summary={**plan.summary, PREDICTED: bound, FROM_REST: from_rest})
    return with_warning(
        included,
        f"the tips swing by {amplitude:.3g} m before the plan begins, and their state is not "
        "known: "
        f"the predicted residual is the bound {bound:.3g} m, {from_rest:.3g} m from rest and the "
        "swing undamped",
    )
