"""Dormand and Prince's scheme of order 5 for second-order equations, many trials side by side.

As the slopes of positions are the rates, only accelerations are kept: with A the scheme's matrix
positions follow by A A, which is Nystrom's form of the same scheme.
"""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from flexslew_plant.arrays import Vector, vectorised
from flexslew_plant.testbeds.compiled.lanes import Advance

STAGES = 6
# a_ij of Dormand and Prince (1980), the last row the solution's
_A = np.zeros((STAGES + 1, STAGES))
_A[1, :1] = 1 / 5
_A[2, :2] = 3 / 40, 9 / 40
_A[3, :3] = 44 / 45, -56 / 15, 32 / 9
_A[4, :4] = 19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729
_A[5, :5] = 9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656
_A[6] = 35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84
_AA = _A @ _A[:STAGES]

OnRows: TypeAlias = Callable[[Vector], None]


def order_five(
    half: int, at: int, slope: int, kept: int, begin: OnRows, accelerate: OnRows
) -> Advance:
    """Return the step of the flat array of lanes.Advance.

    Args:
        half: entries of all positions, as many as of all rates.
        at: where the states of a stage begin, 2 half.
        slope: where its accelerations begin, half.
        kept: where those of the stages but the last begin, (STAGES - 1) half.
        begin: is told that a step begins.
        accelerate: writes `slope` from `at` and what else the array holds.
    """

    def stage(number: int) -> Callable[[float, Vector], None]:
        """Return what keeps the slopes of a stage and goes to the next one, at last to the end."""
        target = at if number < STAGES else 0
        whole = float(_A[number].sum())

        @vectorised
        def go(h: float, w: Vector) -> None:
            for i in range(half):
                rate = w[half + i]
                position = w[i] + h * whole * rate
                for j in range(number - 1):
                    kick = w[kept + j * half + i]
                    position += h * h * _AA[number, j] * kick
                    rate += h * _A[number, j] * kick
                kick = w[slope + i]
                position += h * h * _AA[number, number - 1] * kick
                rate += h * _A[number, number - 1] * kick
                if number < STAGES:
                    w[kept + (number - 1) * half + i] = kick
                w[target + i] = position
                w[target + half + i] = rate

        return go

    first, second, third, fourth, fifth, last = map(stage, range(1, STAGES + 1))

    @vectorised
    def step(t: float, dt: float, steps: int, w: Vector) -> None:
        h = dt / steps
        for _ in range(steps):
            begin(w)
            for i in range(2 * half):
                w[at + i] = w[i]
            accelerate(w)
            first(h, w)
            accelerate(w)
            second(h, w)
            accelerate(w)
            third(h, w)
            accelerate(w)
            fourth(h, w)
            accelerate(w)
            fifth(h, w)
            accelerate(w)
            last(h, w)

    return step
