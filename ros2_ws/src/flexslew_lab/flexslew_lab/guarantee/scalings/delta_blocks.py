"""Blocks of Delta in w = Delta v, and the multipliers D and G that fit them."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from flexslew_control.analysis.loop import Complex


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
    """Basis matrices of D and G for a structure: the unknowns of the inequality.

    Attributes:
        terms: the multiplier of each unknown, stacked.
        start: D = 1, G = 0.
        is_g: which unknowns are of G.
    """

    def __init__(self, blocks: DeltaBlocks) -> None:
        spans, count = blocks.spans(), blocks.unknowns
        w, v = spans[-1][0].stop, spans[-1][1].stop
        d, g, e = (np.zeros((count, *shape), complex) for shape in ((v, v), (v, w), (w, w)))
        self.is_g, k = np.zeros(count, bool), 0
        for number, (in_w, in_v) in enumerate(spans):
            if number >= len(blocks.real):
                d[k, in_v, in_v] = np.eye(in_v.stop - in_v.start)
                e[k, in_w, in_w] = np.eye(in_w.stop - in_w.start)
                k += 1
                continue
            basis = _hermitian(blocks.real[number])
            of_d, of_g = slice(k, k + len(basis)), slice(k + len(basis), k + 2 * len(basis))
            d[of_d, in_v, in_v] = e[of_d, in_w, in_w] = basis
            g[of_g, in_v, in_w] = -1j * basis
            self.is_g[of_g], k = True, of_g.stop
        self.terms = Multiplier(d, g, e)
        self.start = np.diagonal(e, axis1=1, axis2=2).any(axis=1).astype(float)


def _hermitian(size: int) -> Complex:
    """Return a basis of Hermitian matrices, shape (size^2, size, size)."""
    out = []
    for i in range(size):
        for k in range(i + 1):
            for value in (1.0,) if i == k else (1.0, 1j):
                one = np.zeros((size, size), complex)
                one[i, k], one[k, i] = value, np.conj(value)
                out.append(one)
    return np.array(out).reshape(size**2, size, size)
