"""What acts on a testbed from outside, as an impulse between its steps: machine code."""

from collections.abc import Callable
from functools import cache
from typing import TypeAlias, cast

import numpy as np

from flexslew_plant.arrays import Vector, compiled_once
from flexslew_plant.testbeds.compiled import interface, mass
from flexslew_plant.testbeds.kernels import Kernels

# (p, numbers of the forces, t, span, entries of v before the modes, x)
Push: TypeAlias = Callable[[Vector, Vector, float, float, int, Vector], None]


@cache
def push_of(kernels: Kernels, add: Callable[..., None]) -> Push:
    """Return what replaces v of a state at t by v + M^-1 f |span|; f: mean from t to t + span."""

    @compiled_once("x")
    def push(p: Vector, numbers: Vector, t: float, span: float, m: int, x: Vector) -> None:
        n = (x.size - interface.extra(kernels)) // 2
        s, first = interface.square(kernels, n, m), x.size - n
        joints, coupling, modal = np.empty((s, s)), np.empty((s, n - s)), np.empty(n - s)
        change = np.empty(n)
        interface.terms(kernels, p, t, x, joints, coupling, modal, change)
        for i in range(n):
            change[i] = 0.0  # the bias is of no use here
        add(numbers, x, t, span, change)
        mass.factor(joints, coupling, modal)
        mass.solve(joints, coupling, modal, change)
        for i in range(n):
            x[first + i] += abs(span) * change[i]

    return cast(Push, push)
