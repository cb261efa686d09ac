"""PID loops with notches, and positive position feedback, as a structure with free parameters."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from flexslew_lab.tuning.closed_loop import PerformancePlant
from flexslew_lab.tuning.settings import NotchFilter, PidBlock, PidLoop
from flexslew_lab.tuning.structures import Parts, held_gain, linear_section
from flexslew_plant.arrays import Vector

_SPREAD = 0.7  # of the other starts, in the logarithm of a parameter


@dataclass(frozen=True)
class PidSystem:
    """PID loops with notches, and positive position feedback; each parameter keeps its sign.

    Args:
        settings: of the tuning file.
        period: one tick [s]; 0: continuous.
    """

    settings: PidBlock
    period: float

    @property
    def signals(self) -> tuple[str, ...]:
        """What it reads, one for each part."""
        return tuple(part.input for part in self._all)

    @property
    def efforts(self) -> tuple[str, ...]:
        """What it commands."""
        outputs = (*self.settings.loops, *(p.output for p in self.settings.position_feedback))
        return tuple(dict.fromkeys(outputs))

    @property
    def _all(self) -> tuple[Any, ...]:
        return (*self.settings.loops.values(), *self.settings.position_feedback)

    @property
    def _named(self) -> list[tuple[str, float]]:
        """Every parameter with its start, in order; zero is none."""
        found: list[tuple[str, float]] = []
        for name, loop in self.settings.loops.items():
            keys = ("kp", "ki", "kd", *(("filter",) if loop.kd else ()))
            found += [(f"{name}.{key}", getattr(loop, key)) for key in keys if getattr(loop, key)]
            for k, notch in enumerate(loop.notches):
                keys = ("frequency", "zeros", "poles")
                found += [(f"{name}.notch_{k + 1}.{key}", getattr(notch, key)) for key in keys]
        for k, one in enumerate(self.settings.position_feedback):
            keys = ("gain", "frequency", "damping")
            found += [(f"position_feedback_{k + 1}.{key}", getattr(one, key)) for key in keys]
        return found

    @property
    def labels(self) -> tuple[str, ...]:
        """Of the parameters."""
        return tuple(name for name, _ in self._named)

    @property
    def start(self) -> Vector:
        """Logarithms of factors on the given values."""
        return np.zeros(len(self._named))

    def other_start(self, rng: np.random.Generator) -> Vector:
        """Return other first values, shape (parameters,)."""
        return np.asarray(_SPREAD * rng.standard_normal(len(self._named)))

    def prepared(self, plant: PerformancePlant) -> PerformancePlant:
        """Return the reduced plant with the controller's states."""
        order = len(self.parts(self.start)[0])
        return plant.reduced().extended(order)

    def values(self, x: Any) -> dict[str, Any]:
        """Return the parameters by label, in their units."""
        return {name: v * np.exp(e) for (name, v), e in zip(self._named, x, strict=True)}

    def parts(self, x: Any) -> Parts:
        """Return A, B, C and D at parameters, continuous."""
        values, blocks = self.values(x), []
        for name, loop in self.settings.loops.items():
            blocks.append(_pid(values, name, loop))
        for k in range(len(self.settings.position_feedback)):
            g, w, z = (values[f"position_feedback_{k + 1}.{key}"]
                       for key in ("gain", "frequency", "damping"))  # fmt: skip
            blocks.append(_second_order(w, z, g * w**2))
        place = np.zeros((len(self.efforts), len(blocks)))
        outputs = (*self.settings.loops, *(p.output for p in self.settings.position_feedback))
        for k, name in enumerate(outputs):
            place[self.efforts.index(name), k] = 1.0
        a, b, c, d = (block_diag(*[block[k] for block in blocks]) for k in range(4))
        return a, b, place @ c, place @ d

    def matrix(self, x: Any) -> Any:
        """Return [[D, C], [B, A]], sampled."""
        return held_gain(self.parts(x), self.period)

    def section(self, x: Vector) -> dict[str, Any]:
        """Return the keys of the law `linear`."""
        return linear_section(self.parts(x), self.signals, self.efforts)


def _second_order(w: Any, z: Any, gain: Any) -> Parts:
    """Return gain / (s^2 + 2 z w s + w^2)."""
    a = np.array([[0.0, 1.0], [-(w**2), -2.0 * z * w]])
    return a, np.array([[0.0], [gain]]), np.array([[1.0, 0.0]]), np.zeros((1, 1))


def _pid(values: dict[str, Any], name: str, loop: PidLoop) -> Parts:
    """Return kp + ki / s + kd s / (tau s + 1), then its notches."""
    kp, ki, kd = (values.get(f"{name}.{key}", 0.0) for key in ("kp", "ki", "kd"))
    tau = values.get(f"{name}.filter", loop.filter)
    a = np.array([[0.0, 0.0], [0.0, -1.0 / tau]])
    b, c = np.array([[1.0], [1.0 / tau]]), np.array([[ki, -kd / tau]])
    keep = [k for k, used in enumerate((loop.ki, loop.kd)) if used]
    found: Parts = (a[np.ix_(keep, keep)], b[keep], c[:, keep], np.array([[kp + kd / tau]]))
    for k, _ in enumerate(loop.notches):
        w, zeros, poles = (values[f"{name}.notch_{k + 1}.{key}"]
                           for key in NotchFilter.__dataclass_fields__)  # fmt: skip
        notch = (
            np.array([[0.0, 1.0], [-(w**2), -2.0 * poles * w]]), np.array([[0.0], [1.0]]),
            np.array([[0.0 * w, 2.0 * (zeros - poles) * w]]), np.ones((1, 1)),
        )  # fmt: skip
        found = _then(found, notch)
    return found


def _then(first: Parts, second: Parts) -> Parts:
    (a, b, c, d), (e, f, g, h) = first, second
    zero = np.zeros((len(a), len(e)))
    return (
        np.block([[a, zero], [f @ c, e]]), np.vstack((b, f @ d)), np.hstack((h @ c, g)), h @ d,
    )  # fmt: skip
