"""Natural modes of a plant: frequency, damping, shape, and the actuators and sensors they reach.

control.damp gives the first two alone; the rest is in the eigenvectors.
"""

from typing import NamedTuple

import numpy as np

from flexslew_control.analysis.lti import Lti
from flexslew_plant.arrays import Vector

_RIGID = 1e-6  # of the fastest mode: slower ones are rigid


class Mode(NamedTuple):
    """One natural motion.

    Args:
        frequency: undamped [rad/s].
        damping: ratio [-].
        shape: of every output of kind position and tip when the largest is one [-].
        moved: how strongly each input moves it, of the mode that it moves most [-].
        seen: how strongly each output sees it, of the mode that it sees most [-].
    """

    frequency: float
    damping: float
    shape: dict[str, float]
    moved: dict[str, float]
    seen: dict[str, float]


def natural_modes(plant: Lti) -> tuple[Mode, ...]:
    """Return the elastic modes of a continuous plant, the slowest first."""
    n = len(plant.a) // 2
    values, right = np.linalg.eig(plant.a)
    lowest = _RIGID * abs(values).max(initial=0.0)
    elastic = np.flatnonzero((values.imag > 0.0) & (abs(values) > lowest))
    order = elastic[np.argsort(abs(values[elastic]))]
    right = right[:, order] / np.linalg.norm(right[:n, order], axis=0)
    left = np.linalg.pinv(np.hstack((right, right.conj())))[: len(order)]
    input_gains, seen = abs(left @ plant.b), abs(plant.c @ right)
    input_gains = input_gains / np.maximum(input_gains.max(axis=0, initial=0.0), 1e-300)
    seen = (seen.T / np.maximum(seen.max(axis=1, initial=0.0), 1e-300)).T
    rows = [k for k, name in enumerate(plant.outputs) if name.startswith(("position", "tip"))]
    found = []
    for k, value in enumerate(values[order]):
        found.append(
            Mode(
                float(abs(value)),
                float(-value.real / abs(value)),
                dict(zip([plant.outputs[j] for j in rows], _real(plant.c[rows] @ right[:, k]),
                         strict=True)),
                dict(zip(plant.inputs, input_gains[k].tolist(), strict=True)),
                dict(zip(plant.outputs, seen[:, k].tolist(), strict=True)),
            )
        )  # fmt: skip
    return tuple(found)


def _real(shape: "np.typing.NDArray[np.complex128]") -> list[float]:
    """Return a shape turned to the phase of its largest entry, which becomes one."""
    if not abs(shape).any():
        return [0.0] * len(shape)
    aligned: Vector = (shape / shape[np.argmax(abs(shape))]).real
    return [float(part) for part in aligned]
