"""The iteration (25) of Gorinevsky and Vukovich 1998 for the feedforward, both readings of rho."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from scipy.linalg.lapack import dposv

from flexslew_control.planners.feedforward.manoeuvre import TerminalMap
from flexslew_control.planners.progress import Progress, Update
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import PlanFailed

Reading: TypeAlias = Literal["levenberg", "regularised"]
Sensitivities: TypeAlias = Literal["exact", "finite_difference"]

# G is computed again while the last relative change of U was above this. An old G still leads to
# Y = 0, but moves the fixed point of (25) as printed.
_REFRESH: dict[Reading, float] = {"levenberg": 0.1, "regularised": 1e-3}
_DAMPING_DROP, _DAMPING_FLOOR = 1e-2, 1e-6  # of rho per update, and in all
# relative change at which the coarse grid has done its part
_COARSE_TOLERANCE: dict[Reading, float] = {"levenberg": 0.1, "regularised": 1e-3}


@dataclass(frozen=True)
class Options:
    """How to iterate.

    Args:
        reading: regularised, (25) as printed; levenberg, without its term rho U_k, so that rho
            only damps the step and the iteration ends at Y = 0 near the smallest ||U||.
        rho: weight of (22) [1/(N m)^2].
        paper: two evaluations of G with three updates each, rho fixed. Else until convergence,
            and then levenberg's damping falls from update to update.
        sensitivities: exact (adjoint), or the paper's finite differences.
        max_iterations: updates before the iteration is given up.
        tolerance: relative change of U at which it has converged.
    """

    reading: Reading = "levenberg"
    rho: float = 4e-8
    paper: bool = False
    sensitivities: Sensitivities = "exact"
    max_iterations: int = 100
    tolerance: float = 1e-6


@dataclass(frozen=True)
class FeedforwardOptimum:
    """The weights U and the terminal error Y with them, and how they were found."""

    weights: Vector
    terminal_error: Vector
    history: tuple[Update, ...]
    converged: bool
    evaluations: int  # simulations with all sensitivities
    simulations: int  # without


def optimize(
    maps: tuple[TerminalMap, TerminalMap], options: Options, progress: Progress
) -> FeedforwardOptimum:
    """Return the feedforward that minimises (22), from U = 0.

    Regularised (25): U+ = U - (rho I + G^T G)^-1 (rho U + G^T Y) = G^T S^-1 (G U - Y), and
    levenberg: U+ = U - G^T S^-1 Y, with S = rho I + G G^T, which is as small as Y.

    Args:
        maps: Y = S(U) on a coarse grid for the first updates, and on the fine one for the last.
        options: see there.
        progress: called with every update.

    Raises:
        PlanFailed: the iteration diverges or does not settle.
    """
    coarse, fine = maps
    rho = damping = options.rho
    at = fine if options.paper else coarse
    u = np.zeros(at.basis.functions * at.manoeuvre.model.joints)
    y, g, change = at.terminal_error(u), np.empty((0, 0)), np.inf
    history: list[Update] = []
    evaluations, simulations = 0, 1
    while True:
        k = len(history)
        recompute = k % 3 == 0 if options.paper else change > _REFRESH[options.reading]
        if recompute:
            exact = options.sensitivities == "exact"
            g = at.sensitivity() if exact else at.secant(u, y)
            evaluations += 1
        new = _updated(u, y, g, damping, options.reading)
        change = float(np.linalg.norm(new - u) / max(float(np.linalg.norm(new)), 1e-300))
        u = new
        if not options.paper and change < _COARSE_TOLERANCE[options.reading]:
            at = fine
        y = at.terminal_error(u)
        simulations += 1
        yy, uu = float(y @ y), float(u @ u)
        if not np.isfinite(yy + uu):
            raise PlanFailed(_divergence_message(fine, f"update {k + 1} is not finite"))
        history.append(Update(k + 1, yy + rho * uu, yy**0.5, uu**0.5, change, recompute))
        progress(history[-1])
        converged = change <= options.tolerance or uu == 0.0
        if options.paper and k == 5:
            break
        if not options.paper and converged and at is fine:
            break
        if k + 1 >= options.max_iterations:
            reached = f"relative change {change:.1e}, allowed {options.tolerance:.1e}"
            raise PlanFailed(
                _divergence_message(fine, f"after {k + 1} updates: {reached}, |Y| {yy**0.5:.1e}")
            )
        if options.reading == "levenberg" and not options.paper:
            damping = max(damping * _DAMPING_DROP, rho * _DAMPING_FLOOR)
    return FeedforwardOptimum(u, y, tuple(history), converged, evaluations, simulations)


def _updated(u: Vector, y: Vector, g: Matrix, rho: float, reading: Reading) -> Vector:
    """Return U_k+1; not finite where S cannot be factored."""
    s = g @ g.T
    s.flat[:: len(s) + 1] += rho
    right = y if reading == "levenberg" else y - g @ u
    _, solution, info = dposv(s, right)
    if info:
        return np.full_like(u, np.nan)
    step = g.T @ solution
    return np.asarray(u - step if reading == "levenberg" else -step)


def _divergence_message(at: TerminalMap, what: str) -> str:
    m = at.manoeuvre
    return (
        f"the feedforward did not converge, {what}; use a longer duration than {m.duration:g} s, "
        f"a larger rho, or more functions than {at.basis.functions}"
    )
