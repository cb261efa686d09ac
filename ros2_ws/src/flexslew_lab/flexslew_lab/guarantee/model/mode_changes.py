"""A sampled plant whose natural modes have other frequencies and damping ratios."""

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from flexslew_control.analysis.lti import Lti
from flexslew_control.analysis.modes import Mode
from flexslew_plant.arrays import Matrix
from flexslew_plant.errors import BadInput

_SAME = 0.02  # relative difference of a frequency in the sampled plant from that of its mode


class ModeChange(NamedTuple):
    """What a mode has instead: frequency [rad/s] and damping ratio [-]; None: its own."""

    frequency: float | None = None
    damping: float | None = None


def mode_key(name: str) -> tuple[int, str] | None:
    """Return the mode (from 0) and the key of `mode.N.frequency` or `mode.N.damping`, or None."""
    found = re.fullmatch(r"mode\.([1-9][0-9]*)\.(frequency|damping)", name)
    return None if found is None else (int(found[1]) - 1, found[2])


def with_modes(
    plant: Lti, own: tuple[str, ...], modes: tuple[Mode, ...], changes: Mapping[int, ModeChange]
) -> Lti:
    """Return the sampled plant with modes changed, their shapes as they are.

    A mode has a displacement e with e'' + 2 zeta w e' + w^2 e = b u, so [e, e'] has the dynamics
    A_k, exp(A_k h) over a tick, and H_k b with H_k = A_k^-1 (exp(A_k h) - I) of an effort that is
    held. Both are exchanged for those of other numbers. Exact where shapes are real.

    Args:
        plant: sampled, motors and delays included.
        own: names of its states that are displacements and rates of the equations of motion.
        modes: natural modes, the slowest first.
        changes: by the number of the mode.

    Raises:
        BadInput: if a mode is not in the sampled plant, as one faster than half of its rate.
    """
    h, inside = float(plant.period or 0.0), np.array([plant.states.index(name) for name in own])
    outside = np.setdiff1d(np.arange(len(plant.a)), inside)
    f, entry, b = plant.a[np.ix_(inside, inside)], plant.a[np.ix_(inside, outside)], plant.b[inside]
    z, right = np.linalg.eig(f)
    left, s = np.linalg.inv(right), np.log(z.astype(complex)) / h
    moved, pushed = np.zeros_like(f), np.zeros_like(f)
    for number, change in changes.items():
        mode = modes[number]
        k = int(np.argmin(np.where(s.imag > 0.0, abs(abs(s) - mode.frequency), np.inf)))
        w = mode.frequency if change.frequency is None else change.frequency
        if abs(abs(s[k]) / mode.frequency - 1.0) > _SAME or not w * h < np.pi:
            raise BadInput(f"vary: mode.{number + 1} is too fast for the period of a tick")
        shape = right[np.argmax(abs(right[: len(f) // 2, k])), k]
        values = np.array([s[k], s[k].conj()])
        states = np.vstack((np.ones(2), values))  # [e, e'] of each eigenvector
        out = np.column_stack((right[:, k], right[:, k].conj())) / [shape, shape.conj()]
        out = (out @ np.linalg.inv(states)).real
        into = (states @ (np.vstack((left[k], left[k].conj())).T * [shape, shape.conj()]).T).real
        now, held = _tick(_dynamics(abs(s[k]), -s[k].real / abs(s[k])), h)
        # what the integration adds to the frequency and the damping stays
        more = -s[k].real / abs(s[k]) - mode.damping
        zeta = (mode.damping if change.damping is None else change.damping) + more
        then, held_then = _tick(_dynamics(w * abs(s[k]) / mode.frequency, zeta), h)
        moved += out @ (then - now) @ into
        pushed += out @ (held_then @ np.linalg.inv(held) - np.eye(2)) @ into
    a, inputs = plant.a.copy(), plant.b.copy()
    a[np.ix_(inside, inside)] = f + moved
    a[np.ix_(inside, outside)] = entry + pushed @ entry
    inputs[inside] = b + pushed @ b
    return replace(plant, a=a, b=inputs)


def _dynamics(frequency: float, damping: float) -> Matrix:
    return np.array([[0.0, 1.0], [-(frequency**2), -2.0 * damping * frequency]])


def _tick(dynamics: Matrix, h: float) -> tuple[Matrix, Matrix]:
    """Return exp(A h) and A^-1 (exp(A h) - I)."""
    over = np.asarray(expm(dynamics * h))
    return over, np.asarray(np.linalg.solve(dynamics, over - np.eye(2)), dtype=np.float64)
