"""Blocks of Delta in w = Delta v, and the multipliers D and G that fit them."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from flexslew_control.analysis.loop import Complex
from flexslew_plant.arrays import Matrix


@dataclass(frozen=True)
class DeltaBlocks:
    """Structure of Delta: w = Delta v.

    Args:
        real: size of each repeated real parameter.
        full: rows (of w) and columns (of v) of each full complex block, behind them.
    """

    real: tuple[int, ...]
    full: tuple[tuple[int, int], ...] = ()

    @property
    def unknowns(self) -> int:
        """Number of the inequality's unknowns: D and G of each real block, d of each full one."""
        return sum(2 * size**2 for size in self.real) + len(self.full)

    def spans(self) -> list[tuple[slice, slice]]:
        """Return the rows of w and of v of each block."""
        w = np.cumsum([0, *self.real, *(block[0] for block in self.full)])
        v = np.cumsum([0, *self.real, *(block[1] for block in self.full)])
        return [
            (slice(a, b), slice(c, d))
            for (a, b), (c, d) in zip(pairwise(w.tolist()), pairwise(v.tolist()), strict=True)
        ]


@dataclass(frozen=True)
class Multiplier:
    """Pi of [v; w]* Pi [v; w] >= 0 for all w = Delta v in the box.

    Args:
        by_v: D on v, shape (v, v).
        across: -j G, shape (v, w).
        by_w: D on w, shape (w, w).
    """

    by_v: Complex
    across: Complex
    by_w: Complex

    def phi(self, m: Complex) -> Complex:
        """Return Phi of matrices M, shape (..., v, w): negative where Delta is harmless."""
        star = np.conj(np.swapaxes(m, -1, -2))
        mixed = star @ self.across
        return np.asarray(
            star @ self.by_v @ m + mixed + np.conj(np.swapaxes(mixed, -1, -2)) - self.by_w
        )


class MultiplierBasis:
    """Basis matrices of D and G for a structure: the unknowns of the inequality."""

    def __init__(self, blocks: DeltaBlocks) -> None:
        spans = blocks.spans()
        w, v = spans[-1][0].stop, spans[-1][1].stop
        self.by_v: list[Complex] = []
        self.across: list[Complex] = []
        self.by_w: list[Complex] = []
        for number, (in_w, in_v) in enumerate(spans):
            if number >= len(blocks.real):
                self._add(v, w, in_v, in_w, np.eye(in_v.stop - in_v.start),
                          np.eye(in_w.stop - in_w.start))  # fmt: skip
                continue
            basis = _hermitian(blocks.real[number])
            for one in basis:
                self._add(v, w, in_v, in_w, one, one)
            for one in basis:
                self._add_across(v, w, in_v, in_w, one)
        shape = len(self.by_v)
        self.d = np.array(self.by_v).reshape(shape, v, v)
        self.g = np.array(self.across).reshape(shape, v, w)
        self.e = np.array(self.by_w).reshape(shape, w, w)
        diagonal = [bool(np.diagonal(e).any()) for e in self.e]
        self.start = np.where(diagonal, 1.0, 0.0)  # D = 1, G = 0
        self.is_g = abs(self.g).sum(axis=(1, 2)) > 0.0

    def _add(
        self,
        v: int,
        w: int,
        in_v: slice,
        in_w: slice,
        of_v: Complex | Matrix,
        of_w: Complex | Matrix,
    ) -> None:
        d, e = np.zeros((v, v), complex), np.zeros((w, w), complex)
        d[in_v, in_v], e[in_w, in_w] = of_v, of_w
        self.by_v.append(d)
        self.across.append(np.zeros((v, w), complex))
        self.by_w.append(e)

    def _add_across(self, v: int, w: int, in_v: slice, in_w: slice, one: Complex) -> None:
        g = np.zeros((v, w), complex)
        g[in_v, in_w] = -1j * one
        self.by_v.append(np.zeros((v, v), complex))
        self.across.append(g)
        self.by_w.append(np.zeros((w, w), complex))


def _hermitian(size: int) -> list[Complex]:
    """Return a basis of Hermitian matrices."""
    out = []
    for i in range(size):
        for k in range(i + 1):
            for value in (1.0,) if i == k else (1.0, 1j):
                one = np.zeros((size, size), complex)
                one[i, k], one[k, i] = value, np.conj(value)
                out.append(one)
    return out
