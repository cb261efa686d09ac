"""Which poles stand in the record of a pulse: those of the loop, and those of the estimator."""

import numpy as np

from flexslew_control.analysis.linear_plant import Path, sampled_plant
from flexslew_control.analysis.loop import Complex, Loop, visible_poles
from flexslew_control.analysis.rest import Rest
from flexslew_plant.arrays import Vector

FADE = 20  # ticks after the pulse at which a record begins, at the earliest

_FADED = 1e-10  # of a pole's part when the record begins: it is not in it
_VISIBLE = 1e-6  # strength of a pole of the loop that a record is to show
_PART = 1e-10  # of a record, in every channel: less of a pole is not in it


def asked_poles(loop: Loop) -> Complex:
    """Return the poles in z that efforts move and sensors see, and that outlast FADE ticks.

    One of each pair, shape (k,).
    """
    z, _ = visible_poles(loop, _VISIBLE)
    return z[(z.imag >= 0.0) & (abs(z) ** FADE > _FADED)]


def other_poles(
    loop: Loop, rest: Rest, limits: Vector, asked: Complex, begins: int, ticks: int
) -> Complex:
    """Return the further poles in z of a record after a push that the controller is not told of.

    An effort moves plant and estimator alike, a disturbance the plant alone: the poles of the
    estimator's error, which no margin knows, are in the record, too.

    Args:
        loop: that flies.
        rest: where it does.
        limits: of the efforts, the push is a share of them, shape (efforts,).
        asked: the poles that are known to be in it.
        begins: first tick of the record, after the pulse.
        ticks: its length.
    """
    closed = loop.closed
    bare = sampled_plant(rest, Path(closed.period))
    kept = [k for k, name in enumerate(bare.states) if not name.startswith("applied.")]
    push = np.zeros(len(closed.a))
    push[[closed.states.index(bare.states[k]) for k in kept]] = bare.b[kept] @ limits
    seen = np.zeros((len(bare.outputs), len(closed.a)))
    seen[:, [closed.states.index(bare.states[k]) for k in kept]] = bare.c[:, kept]
    z, right = np.linalg.eig(closed.a)
    moved = np.linalg.pinv(right) @ push
    squares = np.array([np.sum(abs(value) ** (2.0 * np.arange(begins, begins + ticks)))
                        for value in z])  # fmt: skip
    parts = abs(seen @ right) * abs(moved) * np.sqrt(squares)
    share = parts / np.maximum(parts.max(axis=1, keepdims=True), 1e-300)
    shown = (share.max(axis=0) > _PART) & (abs(z) ** FADE > _FADED) & (z.imag >= 0.0)
    return np.asarray(z[shown & ~np.isin(z, asked)], dtype=np.complex128)
