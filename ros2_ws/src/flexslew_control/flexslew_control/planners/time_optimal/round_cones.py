"""The fastest turn that keeps out of the cones of `keep_out`, and below a rate, on pieces."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from flexslew_control.planners.progress import Progress
from flexslew_control.planners.time_optimal.fastest_turns import (
    STEPS,
    Fastest,
    fastest_flexible,
    from_starts,
    transcribed,
)
from flexslew_control.planners.time_optimal.path_limits import PathLimits
from flexslew_control.planners.time_optimal.reorientation import Reorientation
from flexslew_control.planners.time_optimal.sequential_programs import LocalArcs, fastest_near
from flexslew_plant.arrays import Matrix
from flexslew_plant.errors import PlanFailed

_WIDER, _WIDENINGS = 1e-3, 4  # spare of the path's limits [rad, -], and how often it may grow


def require_free_ends(limits: PathLimits, slew: Reorientation) -> None:
    """Check that start and goal are within the limits.

    Raises:
        PlanFailed: one of them looks into a cone, and by how much.
    """
    ends = limits.excess(slew.model, np.array([slew.start, slew.rest]))
    for name, (first, last) in zip(limits.names, ends.T, strict=True):
        if max(first, last) > 0.0:
            where = "start" if first > 0.0 else "goal"
            raise PlanFailed(f"the {where} looks into {name}, by {max(first, last):.3g} rad")


def fastest_within(
    limits: PathLimits,
    slew: Reorientation,
    stiff: Reorientation,
    on_ticks: Callable[[Fastest], tuple[Matrix, Matrix]],
    progress: Progress,
) -> tuple[Fastest, Matrix, Matrix]:
    """Return the fastest slew that keeps to the limits at all ticks, and its states and efforts.

    The programs look at the ends of the pieces; what lies beyond between them is spared there.

    Args:
        limits: of the path.
        slew: what is turned.
        stiff: the same without modes.
        on_ticks: from a slew to its states at the ticks and efforts.
        progress: called after every start.

    Raises:
        PlanFailed: no slew does.
    """
    spare, local = _WIDER, None
    for _ in range(_WIDENINGS):
        held = replace(limits, spare=spare)
        body = replace(stiff, limits=held)
        if local is None:
            found = from_starts(body, progress)
            local = LocalArcs(found[0].duration, np.repeat(found[0].shares, 2, axis=0), np.inf)
        local = fastest_near(body, local.shares, local.duration, STEPS)
        best = transcribed(body, local, len(found))
        if slew.model.modes:
            best = fastest_flexible(replace(slew, limits=held), best)
        states, effort = on_ticks(best)
        beyond = float(limits.excess(slew.model, states).max())
        if beyond <= 0.0:
            return best, states, effort
        spare += 2.0 * beyond
    names = ", ".join(limits.names)
    raise PlanFailed(f"no slew keeps to {names}: {beyond:.2g} beyond is left; change the goal")
