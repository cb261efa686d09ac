"""The statement of a plan about the optimality of its slew."""

from flexslew_control.planners.time_optimal.all_drives import AllDrives
from flexslew_control.planners.time_optimal.bang_bang import STENCIL, BangBang
from flexslew_control.planners.time_optimal.optimal_switching import KnownOptimum
from flexslew_control.planners.time_optimal.pontryagin import Extremality
from flexslew_control.planners.time_optimal.structures import Structure, closed_form
from flexslew_plant.arrays import Vector
from flexslew_plant.counted import count_text


def joint_sensitivity(slew: BangBang, durations: Vector) -> float:
    """Return d(joint position at the end)/d(stiffness factor), under the feedback if any."""
    return float(sum(w * slew.final(durations, f, True)[slew.joint] for f, w in STENCIL))


def statement(
    slew: BangBang | AllDrives,
    durations: Vector,
    check: Extremality,
    structure: Structure = "fewest",
    optimum: KnownOptimum | None = None,
) -> str:
    """Return in one sentence what is known of the slew's optimality."""
    switches, duration = durations.size - 1, float(durations.sum())
    if check.holds:
        edges = count_text(switches, "switch", "switches")
        return f"extremal with {edges}: Pontryagin's condition holds"
    if isinstance(slew, AllDrives) and slew.has_partial_efforts:
        return (
            f"the optimum of a transcription on {switches + 1} intervals; its arcs do not settle, "
            "as some effort hardly matters"
        )
    text = (
        f"best of the {switches}-switch family, not time-optimal: the switching function has the "
        f"wrong sign at {check.at:.3f} s ({100.0 * check.violation:.1f} % of its largest value)"
    )
    if not can_reduce_time(slew, check, structure):
        return f"{text}; no extremal was found"
    if optimum is None:
        return f"{text}; structure: optimal searches for more switches"
    less = duration - optimum.duration
    if optimum.switches is None:
        return f"{text}; no slew is more than {less:.3g} s faster"
    edges = count_text(optimum.switches, "switch", "switches")
    return f"{text}; structure: optimal takes {less:.3g} s less with {edges}"


def can_reduce_time(slew: BangBang | AllDrives, check: Extremality, structure: Structure) -> bool:
    """Return whether structure: optimal may find a faster slew."""
    has_closed_form = isinstance(slew, BangBang) and closed_form(slew)
    return has_closed_form and not check.holds and structure != "optimal"
