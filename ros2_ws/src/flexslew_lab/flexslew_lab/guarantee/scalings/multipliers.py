"""Scalings D and G that keep I - M Delta regular at one frequency, by a linear matrix inequality.

For real, repeated delta_i and full complex blocks mu is less than one where D = D* > 0 and G = G*,
block by block as Delta, make

    Phi = M* D M + j (G M - M* G) - D < 0

(Fan, Tits and Doyle, Robustness in the presence of mixed parametric uncertainty and unmodeled
dynamics, IEEE Transactions on Automatic Control 36, 1991). Full blocks have a number d, and no G.
For one repeated real number, alone or with one full block, this is exact (Meinsma, Shrivastava and
Fu, IEEE Transactions on Automatic Control 42, 1997).
"""

import numpy as np

from flexslew_control.analysis.loop import Complex
from flexslew_lab.guarantee.deadline import require_time
from flexslew_lab.guarantee.scalings.delta_blocks import DeltaBlocks, Multiplier, MultiplierBasis
from flexslew_plant.arrays import Matrix, Vector

MOST_UNKNOWNS = 500  # of an inequality: more take minutes
_LEAST = 1e-7  # of the sum of the scalings: a smaller margin is none
_ITERATIONS = 80
_GROWTH, _LAST_PUSH = 10.0, 1e6
_MORE_STEPS = 4  # with a positive margin, for a wide interval of frequencies
_G_COST = 1e-10  # of G squared: a matrix M that is nearly real leaves parts of G free
_NEAR_PATH = 0.5  # decrement of Newton's method [-]
_BALANCING = 8


class Scalings:
    """The inequality of one structure, for many matrices M."""

    def __init__(self, blocks: DeltaBlocks) -> None:
        self.blocks = blocks
        self._basis = MultiplierBasis(blocks)

    def multiplier(self, m: Complex, end: float = np.inf) -> Multiplier | None:
        """Return the scalings with the largest margin for M, or None: there are none.

        Args:
            m: shape (v, w).
            end: of the search, as time.thread_time counts [s].

        Raises:
            OutOfTimeError: after it.
        """
        left, right = self.balance(m)
        try:
            found = self._solve(left[:, None] * m / right, end)
        except np.linalg.LinAlgError:  # the path has left the cone by rounding
            return None
        if found is None:
            return None
        return Multiplier(
            left[:, None] * found.by_v * left,
            left[:, None] * found.across * right,
            right[:, None] * found.by_w * right,
        )

    def balance(self, m: Complex) -> tuple[Vector, Vector]:
        """Return factors on v and w, shapes (v,) and (w,), that balance M; Osborne's method."""
        spans, size = self.blocks.spans(), abs(m)
        w = np.ones(m.shape[1])
        v = np.ones(m.shape[0])
        groups = []
        for number, (in_w, in_v) in enumerate(spans):
            if number < len(self.blocks.real):
                groups += [
                    (slice(a, a + 1), slice(b, b + 1))
                    for a, b in zip(
                        range(in_w.start, in_w.stop), range(in_v.start, in_v.stop), strict=True
                    )
                ]
            else:
                groups.append((in_w, in_v))  # fmt: skip
        floor = 1e-6 * max(float(size.max(initial=0.0)), 1e-300)
        for _ in range(_BALANCING):
            for in_w, in_v in groups:
                scaled = v[:, None] * size / w
                out, into = np.linalg.norm(scaled[in_v]), np.linalg.norm(scaled[:, in_w])
                factor = np.sqrt((into + floor) / (out + floor))
                v[in_v] *= factor
                w[in_w] *= factor
        return v, w

    def _solve(self, m: Complex, end: float) -> Multiplier | None:
        """Return scalings with a margin t, Phi + t < 0, D > 0 and a fixed sum of D.

        Newton's method along the central path of the barrier -log det(-Phi - t) - log det D; it
        ends soon after t is positive, or where t plus the duality gap is negative. For matrices as
        small and dense as these it takes a small part of the time of Clarabel.
        """
        b, w, of_w = self._basis, m.shape[1], self._basis.terms.by_w
        phi = b.terms.phi(m)
        slopes: list[Complex] = [np.concatenate((-phi, -np.eye(w, dtype=complex)[None]))]
        for rows, _ in self.blocks.spans():
            k = rows.stop - rows.start
            if k:
                slopes.append(np.concatenate((of_w[:, rows, rows], np.zeros((1, k, k), complex))))
        sums = np.append(np.trace(of_w, axis1=1, axis2=2).real, 0.0)
        x = np.append(b.start, 0.0)
        x[-1] = float(np.linalg.eigvalsh(np.tensordot(x, slopes[0], 1))[0]) - 1.0
        constraints = sum(part.shape[1] for part in slopes)
        push, inside = constraints / (1.0 + abs(x[-1])), 0
        for _ in range(_ITERATIONS):
            require_time(end)
            gradient, hessian = _barrier(x, slopes)
            gradient[-1] -= push
            gradient[:-1] += _G_COST * b.is_g * x[:-1]
            hessian[range(len(x) - 1), range(len(x) - 1)] += _G_COST * b.is_g
            hessian[range(len(x)), range(len(x))] += 1e-13 * np.trace(hessian)
            steps = np.linalg.solve(hessian, np.column_stack((-gradient, sums)))
            step = steps[:, 0] - steps[:, 1] * (sums @ steps[:, 0]) / (sums @ steps[:, 1])
            decrement = float(np.sqrt(max(-gradient @ step, 0.0)))
            x = _advanced(x, step, slopes, decrement)
            inside += x[-1] > _LEAST
            if inside > _MORE_STEPS:
                break
            if decrement > _NEAR_PATH:
                continue
            if x[-1] + 2.0 * constraints / push < 0.0 or push > _LAST_PUSH:
                return None
            push *= _GROWTH
        return self._checked(m, x[:-1])

    def _checked(self, m: Complex, x: Vector) -> Multiplier | None:
        """Return the multiplier of a solution, D made positive; None where Phi is not negative."""
        terms = self._basis.terms
        by_v, across, by_w = (np.tensordot(x, part, 1) for part in
                              (terms.by_v, terms.across, terms.by_w))  # fmt: skip
        for in_w, in_v in self.blocks.spans():
            block = by_w[in_w, in_w]
            if not block.size:
                continue
            shift = max(0.0, _LEAST - float(np.linalg.eigvalsh(block)[0]))
            by_w[in_w, in_w] += shift * np.eye(len(block))
            by_v[in_v, in_v] += shift * np.eye(in_v.stop - in_v.start)
        made = Multiplier(by_v, across, by_w)
        return made if np.linalg.eigvalsh(made.phi(m))[-1] < 0.0 else None


def _barrier(x: Vector, slopes: list[Complex]) -> tuple[Vector, Matrix]:
    """Return gradient and Hessian of the sum of -log det of matrices that are linear in x."""
    gradient, hessian = np.zeros(len(x)), np.zeros((len(x), len(x)))
    for part in slopes:
        root = np.linalg.inv(np.linalg.cholesky(np.tensordot(x, part, 1)))
        shape: tuple[int, ...] = part.shape
        star = root.conj().T
        half = (part.reshape(-1, shape[2]) @ star).reshape(shape)  # one product of large matrices
        across = np.conj(np.swapaxes(half, 1, 2)).reshape(-1, shape[1])
        scaled = (across @ star).reshape(shape)  # the parts are Hermitian, so is this
        gradient -= np.einsum("nii->n", scaled).real
        flat = scaled.reshape(len(x), -1)
        flat = np.hstack((flat.real, flat.imag))
        hessian += flat @ flat.T
    return gradient, hessian


def _advanced(x: Vector, step: Vector, slopes: list[Complex], decrement: float) -> Vector:
    """Return the point after the longest of a few steps that stays inside of the constraints.

    A step of 1 / (1 + decrement) always does (Nesterov and Nemirovskii, 1994).
    """
    sure = 1.0 / (1.0 + decrement)
    for length in (1.0, 0.5, 0.25):
        if length <= sure:
            break
        try:
            for part in slopes:
                np.linalg.cholesky(np.tensordot(x + length / 0.9 * step, part, 1))
        except np.linalg.LinAlgError:
            continue
        return np.asarray(x + length * step)
    return np.asarray(x + sure * step)
