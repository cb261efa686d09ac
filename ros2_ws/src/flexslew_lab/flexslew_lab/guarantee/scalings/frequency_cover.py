"""One set of scalings holds on a whole interval of frequencies: all of them are covered.

With z = (1 + s) / (1 - s) the unit circle is the imaginary axis. For fixed scalings Phi(j nu) is
singular where j nu is an eigenvalue of a Hamiltonian matrix. So Phi stays negative from a frequency
where it is, to the nearest such eigenvalue on either side, and no peak of mu between two grid
points can be missed (Ferreres, Magni and Biannic, Robustness analysis of flexible structures:
practical algorithms, International Journal of Robust and Nonlinear Control 13, 2003).
"""

from dataclasses import dataclass

import numpy as np

from flexslew_control.analysis.loop import Complex
from flexslew_control.analysis.lti import transfer
from flexslew_lab.guarantee.deadline import OutOfTimeError
from flexslew_lab.guarantee.scalings.delta_blocks import DeltaBlocks, Multiplier
from flexslew_lab.guarantee.scalings.multipliers import Scalings
from flexslew_plant.arrays import Matrix, Vector

_AXIS = 1e-3  # real part, of an eigenvalue's size, at which it may be on the axis
_PLACES = (0.15, 0.4, 0.6, 0.85, 1.0)  # between two such eigenvalues
_CLEAR = 1e-9  # of the eigenvalues of Phi: the largest one is negative
_FLOOR = 1e-11  # of the largest eigenvalue: rounding
_NARROW = 1e-9  # of an angle: an interval that is no wider covers nothing


@dataclass(frozen=True)
class LoopChannels:
    """From w to v, x(k + 1) = A x + B w, v = C x + D w, all poles within the unit circle."""

    a: Matrix
    b: Matrix
    c: Matrix
    d: Matrix

    def at(self, angle: float | Vector) -> Complex:
        """Return M at z = exp(j angle), shape (..., v, w)."""
        z = np.asarray(np.exp(1j * np.asarray(angle)))
        found = transfer((self.a, self.b, self.c, self.d), z.reshape(-1))
        return found.reshape(*z.shape, *self.d.shape)

    def continuous(self) -> "LoopChannels":
        """Return it with z = (1 + s) / (1 - s)."""
        eye = np.eye(len(self.a))
        inverse = np.linalg.inv(self.a + eye)
        return LoopChannels(
            inverse @ (self.a - eye),
            np.sqrt(2.0) * inverse @ self.b,
            np.sqrt(2.0) * self.c @ inverse,
            self.d - self.c @ inverse @ self.b,
        )


@dataclass(frozen=True)
class Arc:
    """Frequencies that one multiplier covers, as angles of z [rad], 0 to pi."""

    low: float
    high: float
    multiplier: Multiplier


@dataclass(frozen=True)
class Cover:
    """Arcs that cover all frequencies, or the angle where no scalings were found [rad]."""

    arcs: tuple[Arc, ...]
    open_at: float | None

    @property
    def complete(self) -> bool:
        """Whether every frequency is covered."""
        return self.open_at is None


def cover(
    channels: LoopChannels, scalings: Scalings, first: list[float], end: float = np.inf
) -> Cover:
    """Return arcs that cover all angles from 0 to pi, or the first that none covers.

    Args:
        channels: from w to v.
        scalings: of its structure.
        first: angles to begin with, as those of lightly damped poles [rad].
        end: of the search, as time.thread_time counts [s].
    """
    continuous = channels.continuous()
    open_parts = [(0.0, np.pi)]
    arcs: list[Arc] = []
    queue = sorted({0.0, np.pi, *(a for a in first if 0.0 < a < np.pi)})
    while open_parts:
        low, high = open_parts[0]
        angle = next((a for a in queue if low <= a <= high), None)
        if angle is None:
            angle = _middle(low, high)
        else:
            queue.remove(angle)
        try:
            found = scalings.multiplier(channels.at(angle), end)
        except OutOfTimeError:
            found = None
        if found is None:
            return Cover(tuple(arcs), angle)
        try:
            arc = _arc(channels, continuous, found, angle)
        except np.linalg.LinAlgError:  # Phi is singular at z = -1
            return Cover(tuple(arcs), angle)
        if arc.high - arc.low < _NARROW * max(angle, _NARROW):
            return Cover(tuple(arcs), angle)
        arcs.append(arc)
        open_parts = [part for one in open_parts for part in _without(one, arc)]
    return Cover(tuple(arcs), None)


def _middle(low: float, high: float) -> float:
    """Return an angle between two: the geometric mean unless the lower one is zero."""
    if low == high:
        return low
    return 0.5 * (low + high) if low < 1e-3 * high else float(np.sqrt(low * high))


def _without(part: tuple[float, float], arc: Arc) -> list[tuple[float, float]]:
    """Return what is left of a closed part outside of an open arc; its ends stay open."""
    low, high = part
    out = []
    if low <= min(arc.low, high):
        out.append((low, min(arc.low, high)))
    if max(arc.high, low) <= high:
        out.append((max(arc.high, low), high))
    return out


def _arc(
    system: LoopChannels, continuous: LoopChannels, multiplier: Multiplier, angle: float
) -> Arc:
    """Return how far a multiplier that holds at an angle does so, in both directions.

    Eigenvalues near the axis count as on it. One at which Phi is clearly negative, as it is between
    it and the next one, is no crossing. Ends beyond 0 or pi leave the closed range covered.
    """
    values = _hamiltonian_eigenvalues(continuous, multiplier)
    size = abs(values)
    near = abs(values.real) <= _AXIS * size + _FLOOR * size.max(initial=0.0)
    crossings = np.unique(2.0 * np.arctan(values[near].imag))
    below = [*crossings[crossings <= angle][::-1], -1.0]
    above = [*crossings[crossings >= angle], 4.0]
    low, high = (_reach(system, multiplier, angle, ends) for ends in (below, above))
    return Arc(low, high, multiplier)


def _reach(system: LoopChannels, multiplier: Multiplier, angle: float, ends: list[float]) -> float:
    """Return the first of the possible ends of an arc at which Phi is not clearly negative."""
    before = angle
    for end in ends:
        last = float(np.clip(end, 0.0, np.pi))
        places = np.array([before + share * (last - before) for share in _PLACES])
        top = np.linalg.eigvalsh(multiplier.phi(system.at(places)))
        if (top[:-1, -1] >= 0.0).any():
            return before
        if not 0.0 <= end <= np.pi:
            return end if top[-1, -1] < 0.0 else before
        if top[-1, -1] >= -_CLEAR * abs(top[-1]).max():
            return float(end)
        before = last
    return before


def _hamiltonian_eigenvalues(system: LoopChannels, multiplier: Multiplier) -> Complex:
    """Return where Phi(s) is singular, continued from the imaginary axis."""
    c, d = system.c, system.d
    q = c.T @ multiplier.by_v @ c
    s = c.T @ (multiplier.by_v @ d + multiplier.across)
    r = multiplier.phi(d.astype(complex))
    by_state = np.linalg.solve(r, s.conj().T)
    a = system.a - system.b @ by_state
    quadratic = -system.b @ np.linalg.solve(r, system.b.T.astype(complex))
    constant = -(q - s @ by_state)
    return np.asarray(np.linalg.eigvals(np.block([[a, quadratic], [constant, -a.conj().T]])))


def peak(
    channels: LoopChannels,
    blocks: DeltaBlocks,
    angle: float,
    accuracy: float = 0.02,
    end: float = np.inf,
) -> float:
    """Return an upper bound of mu at an angle, by bisection of the scale of the real parameters.

    Full blocks keep their size, so this is a skewed mu: 1 / k for the largest k at which all
    parameters within k times their range are harmless.

    Args:
        channels: from w to v.
        blocks: structure.
        angle: of z [rad].
        accuracy: relative [-].
        end: of the search, as time.thread_time counts [s].

    Raises:
        OutOfTimeError: after it.
    """
    m, real = channels.at(angle), sum(blocks.real)
    scalings = Scalings(blocks)

    def harmless(scale: float) -> bool:
        gain = np.ones(m.shape[1])
        gain[:real] = scale
        return scalings.multiplier(m * gain, end) is not None

    low, high = 1e-3, 1e3
    while high / low > 1.0 + accuracy:
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if harmless(middle) else (low, middle)
    return 1.0 / low
