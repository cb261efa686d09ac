"""What the shared kernels ask of a testbed's own, one function each, resolved at compile time.

Python never runs the bodies here: Numba takes every call for one of the function of the Kernels
object that is its first argument (see kernels.Kernels), and merges the two as machine code.
"""

from collections.abc import Callable
from typing import Any

from numba.extending import overload

from flexslew_plant.arrays import MERGED, Matrix, Vector
from flexslew_plant.testbeds.kernels import Kernels, KernelsType


def terms(
    kernels: Kernels,
    p: Vector,
    t: float,
    x: Vector,
    joints: Matrix,
    coupling: Matrix,
    modal: Vector,
    bias: Vector,
) -> None:
    """Write M(q, t) and h(q, v, t); a full mass matrix is all joints and no modes."""
    raise NotImplementedError


def residual_jacobian(
    kernels: Kernels, p: Vector, t: float, x: Vector, a: Vector, dq: Matrix, dv: Matrix
) -> None:
    """Write the partial derivatives of M a + h at fixed a, shapes (n, positions), (n, n)."""
    raise NotImplementedError


def potential(kernels: Kernels, p: Vector, t: float, q: Vector) -> float:
    """Return the potential energy [J]."""
    raise NotImplementedError


def actuation(
    kernels: Kernels, p: Vector, t: float, x: Vector, effort: Vector, force: Vector
) -> None:
    """Add B u to the generalised forces, shape (n,)."""
    raise NotImplementedError


def position_rates(kernels: Kernels, p: Vector, t: float, x: Vector, rate: Vector) -> None:
    """Write q' into the first entries of rate."""
    raise NotImplementedError


def reading(kernels: Kernels, p: Vector, x: Vector, position: Vector, rate: Vector) -> None:
    """Write where each joint is and how fast, each (joints,)."""
    raise NotImplementedError


def square(kernels: Kernels, n: int, m: int) -> int:
    """Return the size of the joint block of M: m, or n where terms writes the whole matrix."""
    raise NotImplementedError


def extra(kernels: Kernels) -> int:
    """Return how many entries q has more than v."""
    raise NotImplementedError


@overload(terms, strict=False, jit_options=MERGED)
def _terms(kernels: KernelsType, *_: Any) -> Callable[..., Any]:
    function = kernels.kernels.compiled["terms"]
    if kernels.kernels.full_mass:
        return lambda kernels, p, t, x, joints, coupling, modal, bias: function(
            p, t, x, joints, bias
        )
    return lambda kernels, p, t, x, joints, coupling, modal, bias: function(
        p, t, x, joints, coupling, modal, bias
    )


@overload(residual_jacobian, strict=False, jit_options=MERGED)
def _residual_jacobian(kernels: KernelsType, *_: Any) -> Callable[..., Any]:
    function = kernels.kernels.compiled["residual_jacobian"]
    return lambda kernels, p, t, x, a, dq, dv: function(p, t, x, a, dq, dv)


@overload(potential, strict=False, jit_options=MERGED)
def _potential(kernels: KernelsType, *_: Any) -> Callable[..., Any]:
    function = kernels.kernels.compiled["potential"]
    return lambda kernels, p, t, q: function(p, t, q)


@overload(actuation, strict=False, jit_options=MERGED)
def _actuation(kernels: KernelsType, *_: Any) -> Callable[..., Any]:
    function = kernels.kernels.compiled.get("actuation")
    if function is not None:
        return lambda kernels, p, t, x, effort, force: function(p, t, x, effort, force)

    def first(
        kernels: Kernels, p: Vector, t: float, x: Vector, effort: Vector, force: Vector
    ) -> None:
        for i in range(effort.size):
            force[i] += effort[i]

    return first


@overload(position_rates, strict=False, jit_options=MERGED)
def _position_rates(kernels: KernelsType, *_: Any) -> Callable[..., Any]:
    function = kernels.kernels.compiled.get("kinematics")
    if function is not None:
        return lambda kernels, p, t, x, rate: function(p, t, x, rate)

    def same(kernels: Kernels, p: Vector, t: float, x: Vector, rate: Vector) -> None:
        n = x.size // 2
        for k in range(n):
            rate[k] = x[n + k]

    return same


@overload(reading, strict=False, jit_options=MERGED)
def _reading(kernels: KernelsType, *_: Any) -> Callable[..., Any]:
    function = kernels.kernels.compiled.get("reading")
    if function is not None:
        return lambda kernels, p, x, position, rate: function(p, x, position, rate)
    extra_positions = kernels.kernels.extra_positions

    def first(kernels: Kernels, p: Vector, x: Vector, position: Vector, rate: Vector) -> None:
        v = (x.size + extra_positions) // 2
        for k in range(position.size):
            position[k], rate[k] = x[k], x[v + k]

    return first


@overload(square, strict=False, inline="always")
def _square(kernels: KernelsType, *_: Any) -> Callable[..., Any]:
    if kernels.kernels.full_mass:
        return lambda kernels, n, m: n
    return lambda kernels, n, m: m


@overload(extra, strict=False, inline="always")
def _extra(kernels: KernelsType) -> Callable[..., Any]:
    count = kernels.kernels.extra_positions
    return lambda kernels: count
