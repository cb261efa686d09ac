"""The part of a linear system that its inputs move and its outputs see (Kalman 1963).

Square-root balancing (Laub, Heath, Paige and Ward 1987; Tombs and Postlethwaite 1987) of the system
with all poles moved into the stable region, which changes neither what is reached nor what is seen:
so rigid motions are no exception. The factors of its Gramians are summed by doubling (Smith 1968)
and never squared, so what nothing moves stays at rounding, far below what anything moves.
"""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from flexslew_control.analysis.lti import Lti
from flexslew_plant.arrays import Matrix
from flexslew_plant.errors import BadInput

if TYPE_CHECKING:
    import control

_TOLERANCE = 1e-9  # of the largest Hankel singular value
_STATIC = 1e-6  # of the fastest pole: a slower one stands still
_DOUBLINGS = 64  # more than any pole takes that is moved by a part in 1e18 of itself
_ZERO = 1e-20


def minimal(
    system: "control.StateSpace | control.TransferFunction", tolerance: float = _TOLERANCE
) -> "control.StateSpace":
    """Return a system without the states that no input moves or no output sees.

    As `control.minreal`, for which python-control needs slycot, and for undamped and rigid motions,
    too. Take the rows and columns first: `minimal(plant[["position:yaw"], ["effort:yaw"]])`.

    Args:
        system: a state space, or what `control.ss` makes one of; its signals keep their labels.
        tolerance: of the largest Hankel singular value; states below it are left out. A plant of
            the bench has them below 1e-15; of states that were mixed rounding may leave 1e-7.

    Raises:
        BadInput: if it has a number that is not finite.
    """
    import control

    given = control.ss(system)
    names = tuple(given.input_labels), tuple(given.output_labels), tuple(given.state_labels)
    period = 0.0 if given.dt is None else float(given.dt)  # dt = True: 1
    found = minimal_part(Lti(given.A, given.B, given.C, given.D, *names, period), tolerance)
    return control.ss(
        found.a, found.b, found.c, found.d, given.dt,
        inputs=list(names[0]), outputs=list(names[1]), name=given.name,
    )  # fmt: skip


def minimal_part(system: Lti, tolerance: float = _TOLERANCE) -> Lti:
    """Return the part of a system that its inputs move and its outputs see, balanced.

    Args:
        system: n states.
        tolerance: of the largest Hankel singular value; states below it are left out.

    Returns:
        The same from inputs to outputs, with states `balanced.1` ..., at most n.

    Raises:
        BadInput: it has a number that is not finite.
    """
    if not all(np.isfinite(part).all() for part in (system.a, system.b, system.c, system.d)):
        raise BadInput("the system has a number that is not finite")
    eye, period = np.eye(len(system.a)), system.period
    slope = (system.a - eye) / period if period else system.a  # near 1 it keeps the digits
    a, b, c = _stable(system, slope)
    reached, seen = _factor(a, b), _factor(a.T, c.T)
    left, values, right = np.linalg.svd(seen.T @ reached)
    kept = int(np.count_nonzero(values > tolerance * values.max(initial=0.0)))
    scale = 1.0 / np.sqrt(values[:kept])
    right_factor, from_whole = reached @ right[:kept].T * scale, (seen @ left[:, :kept] * scale).T
    part = from_whole @ slope @ right_factor
    return replace(
        system,
        a=np.eye(kept) + period * part if period else part,
        b=from_whole @ system.b,
        c=system.c @ right_factor,
        states=tuple(f"balanced.{k + 1}" for k in range(kept)),
    )


def _stable(system: Lti, slope: Matrix) -> tuple[Matrix, Matrix, Matrix]:
    """Return A, B, C of a stable discrete system that reaches and sees the same."""
    period = system.period
    poles = np.linalg.eigvals(system.a)
    if period:
        poles = np.log(np.where(poles == 0.0, np.finfo(float).tiny, poles).astype(complex)) / period
    sizes = np.abs(poles)
    nonzero = sizes[sizes > _STATIC * sizes.max(initial=0.0)]
    size = float(np.exp(np.log(nonzero).mean())) if nonzero.size else 1.0
    left = size + max(float(poles.real.max(initial=0.0)), 0.0)  # by which they move
    if period:
        return system.a * np.exp(-left * period), system.b, system.c
    eye = np.eye(len(slope))
    shifted = slope - left * eye
    inverse = np.linalg.inv(left * eye - shifted)
    return (left * eye + shifted) @ inverse, inverse @ system.b, system.c @ inverse


def _factor(a: Matrix, b: Matrix) -> Matrix:
    """Return L, (n, n or fewer), with L L^T the sum of a^k b b^T (a^T)^k over all k."""
    factor = b
    for _ in range(_DOUBLINGS):
        stacked = np.hstack((factor, a @ factor))
        factor = np.asarray(np.linalg.qr(stacked.T, mode="r")).T
        a = a @ a
        if np.linalg.norm(a, 1) < _ZERO:
            break
    return factor
