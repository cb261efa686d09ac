"""Numbers of a running law as free parameters: its matrices are affine in them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexslew_control.analysis.lti import Lti
from flexslew_lab.tuning.closed_loop import PerformancePlant
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput

_CHANGE = 0.1  # of each number, for its derivative
_AFFINE = 1e-6  # largest deviation, of the change
_RANK = 1e-9  # smallest singular value of a derivative, of its largest
_SPREAD = 0.4  # of the other starts, in the logarithm of a number


@dataclass(frozen=True)
class LawGains:
    """A law with free numbers: K = K_0 + sum of d_k left_k right_k, d_k the change of number k.

    Args:
        signals: what it reads.
        efforts: what it commands.
        labels: of its numbers, `key` or `key.k`.
        values: of its numbers in the trial, shape (parameters,).
        base: K_0 = [[D, C], [B, A]].
        left, right: of all derivatives, columns and rows.
        repeats: how many of them belong to each number.
        keys: of its section, with their values.
    """

    signals: tuple[str, ...]
    efforts: tuple[str, ...]
    labels: tuple[str, ...]
    values: Vector
    base: Matrix
    left: Matrix
    right: Matrix
    repeats: tuple[int, ...]
    keys: dict[str, Any]

    @property
    def start(self) -> Vector:
        """Logarithms of factors on the trial's numbers."""
        return np.zeros(len(self.labels))

    def other_start(self, rng: np.random.Generator) -> Vector:
        """Return other first values, shape (parameters,)."""
        return np.asarray(_SPREAD * rng.standard_normal(len(self.labels)))

    def prepared(self, plant: PerformancePlant) -> PerformancePlant:
        """Return the reduced plant with the law in it, around the changes of its numbers."""
        whole = plant.extended(len(self.base) - plant.controls)
        return whole.around(self.base, self.left, self.right).reduced()

    def matrix(self, x: Any) -> Any:
        """Return the changes of the numbers on a diagonal."""
        return np.diag(np.repeat(self.values * np.expm1(x), self.repeats))

    def section(self, x: Vector) -> dict[str, Any]:
        """Return the numbers by key."""
        return section_with(self.keys, self.values * np.exp(x))


def section_with(keys: dict[str, Any], values: Sequence[float] | Vector) -> dict[str, Any]:
    """Return keys with other numbers, in order."""
    left, out = [float(value) for value in values], {}
    for key, value in keys.items():
        count = len(value) if isinstance(value, list) else 1
        out[key] = left[:count] if isinstance(value, list) else left[0]
        left = left[count:]
    return out


def law_gains(form_of: Callable[[dict[str, Any]], Lti], keys: dict[str, Any]) -> LawGains:
    """Return a law with free numbers.

    Args:
        form_of: linear form of the running law with other keys.
        keys: of its section, positive numbers or lists of them.

    Raises:
        BadInput: if its matrices are not affine in a number.
    """
    labels, numbers = [], []
    for key, value in keys.items():
        parts = value if isinstance(value, list) else [value]
        labels += [f"{key}.{k + 1}" if isinstance(value, list) else key for k in range(len(parts))]
        numbers += parts
    values = np.array(numbers, dtype=np.float64)
    form = form_of(keys)
    reads, commands = _used(form)
    base = _gain(form, reads, commands)
    factors = []
    for k, label in enumerate(labels):
        other = values.copy()
        other[k] *= 1.0 + _CHANGE
        moved = form_of(section_with(keys, other))
        if moved.states != form.states:
            raise BadInput("changes the number of states of the law", "structure.keys", label)
        slope = (_gain(moved, reads, commands) - base) / (other[k] - values[k])
        if not slope.any():
            raise BadInput("has no effect there", key="structure.keys", value=label)
        u, s, vh = np.linalg.svd(slope)
        rank = int(np.count_nonzero(s > _RANK * s[0]))
        factors.append((u[:, :rank] * s[:rank], vh[:rank]))
    # the other way, so that a curvature shows, and together, so that a product shows
    other_form = form_of(section_with(keys, values * (1.0 - _CHANGE)))
    together, summed = _gain(other_form, reads, commands) - base, np.zeros_like(base)
    for v, (left, right) in zip(values, factors, strict=True):
        summed = summed - _CHANGE * v * left @ right
    if abs(together - summed).max() > _AFFINE * abs(together).max():
        words = "the law is not affine in them; `flexslew gains` varies any number by search"
        raise BadInput(words, key="structure.keys", value=list(keys))
    used = tuple(form.inputs[k] for k in reads), tuple(form.outputs[k] for k in commands)
    return LawGains(
        *used, tuple(labels), values, base, np.hstack([f[0] for f in factors]),
        np.vstack([f[1] for f in factors]), tuple(len(f[1]) for f in factors), keys,
    )  # fmt: skip


def _used(form: Lti) -> tuple[list[int], list[int]]:
    """Return the inputs and outputs that a law uses."""
    reads = [k for k in range(len(form.inputs)) if form.b[:, k].any() or form.d[:, k].any()]
    commands = [k for k in range(len(form.outputs)) if form.c[k].any() or form.d[k].any()]
    return reads, commands


def _gain(form: Lti, reads: list[int], commands: list[int]) -> Matrix:
    return np.block([[form.d[np.ix_(commands, reads)], form.c[commands]],
                     [form.b[:, reads], form.a]])  # fmt: skip
