"""A testbed's kernels as Python calls them: of one size of state, or compiled once for all."""

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
from numba import types

from flexslew_plant.arrays import Matrix, Vector, compiled_once
from flexslew_plant.machine_code.read_only import read_only
from flexslew_plant.testbeds.compiled import dynamics, interface
from flexslew_plant.testbeds.kernels import Kernels, require_equations

_VECTOR = types.Array(types.float64, 1, "C")
_READ = read_only(_VECTOR)
# Bound.advance as an argument of a compiled loop, which so is compiled once for all testbeds
ADVANCE = types.FunctionType(
    types.void(_READ, types.float64, _READ, types.float64, types.int64, types.int64, _VECTOR)
)


_JUMP_MARGIN = 1e-9  # of what is integrated, from a jump
_MATRIX = types.Array(types.float64, 2, "C")
# the same of Rates
RATES = types.FunctionType(types.void(_READ, types.float64, _READ, _READ, _VECTOR))
JACOBIAN = types.FunctionType(types.void(_READ, types.float64, _READ, _READ, _MATRIX, _MATRIX))


class Rates(NamedTuple):
    """The state derivative and its Jacobian as arguments of compiled loops."""

    rates: Callable[[Vector, float, Vector, Vector, Vector], None]  # (p, t, x, effort, out)
    jacobian: Callable[[Vector, float, Vector, Vector, Matrix, Matrix], None]


class Bound(NamedTuple):
    """The kernels of one testbed, called from Python."""

    terms: Callable[[Vector, float, Vector, Matrix, Matrix, Vector, Vector], None]
    derivative: Callable[[Vector, float, Vector, Vector], Vector]
    # (p, t, effort, dt, steps, entries of v before the modes, x)
    advance: Callable[[Vector, float, Vector, float, int, int, Vector], None]
    jacobian: Callable[[Vector, float, Vector, Vector, Matrix, Matrix], None]
    residual_jacobian: Callable[[Vector, float, Vector, Vector, Matrix, Matrix], None]
    energy: Callable[[Vector, float, Vector], float]
    actuation: Callable[[Vector, float, Vector, Vector, Vector], None]
    position_rates: Callable[[Vector, float, Vector, Vector], None]


def bound(kernels: Kernels, n: int, m: int) -> Bound:
    """Return the kernels of a testbed for one size of state.

    Args:
        kernels: its equations.
        n: coordinates.
        m: joints.

    Raises:
        BadInput: it is a black box.
    """
    require_equations(kernels)
    return _of_any_size(kernels, m) if kernels.any_size else _of_size(kernels, n, m)


@cache
def _of_size(kernels: Kernels, n: int, m: int) -> Bound:
    """Return kernels with their sizes built in.

    The compiler unrolls the short loops of constant sizes, and the call from Python costs
    less: half the time of a general function, to the same bits.

    Args:
        kernels: the equations.
        n: number of coordinates.
        m: number of joints.
    """

    @compiled_once("x")
    def advance(
        p: Vector, t: float, effort: Vector, dt: float, steps: int, _: int, x: Vector
    ) -> None:
        held = dynamics.HeldEffort(kernels, p, effort)
        dynamics.take_steps(held, t, dt / steps, steps, n, m, x)

    if kernels.advance is not None:
        return _of_joints(kernels, m)
    return _of_joints(kernels, m)._replace(advance=_in_parts(kernels, advance))


@cache
def _of_joints(kernels: Kernels, m: int) -> Bound:
    """Return kernels with the number of joints built in, the same functions for every size.

    Numba takes two functions of one content for one wherever it copies them: a controller warmed
    as a copy would then meet functions in flight that have not been warmed. So what does not
    depend on the joints is one function for all numbers of them.
    """

    @compiled_once()
    def derivative_(p: Vector, t: float, x: Vector, effort: Vector) -> Vector:
        return dynamics.derivative(kernels, p, t, x, effort, m)

    @compiled_once("dx", "du")
    def jacobian_(p: Vector, t: float, x: Vector, effort: Vector, dx: Matrix, du: Matrix) -> None:
        dynamics.jacobian(kernels, p, t, x, effort, m, dx, du)

    @compiled_once()
    def energy_(p: Vector, t: float, x: Vector) -> float:
        return dynamics.energy(kernels, p, t, x, m)

    terms, residual_jacobian, actuation, position_rates = _of_equations(kernels)
    return Bound(
        terms,
        derivative_,
        _advance(kernels),
        jacobian_,
        residual_jacobian,
        energy_,
        actuation,
        position_rates,
    )


@cache
def _of_equations(kernels: Kernels) -> tuple[Callable[..., None], ...]:
    """Return terms, residual_jacobian, actuation and position_rates of a Bound."""

    @compiled_once("joints", "coupling", "modal", "bias")
    def terms(
        p: Vector,
        t: float,
        x: Vector,
        joints: Matrix,
        coupling: Matrix,
        modal: Vector,
        bias: Vector,
    ) -> None:
        interface.terms(kernels, p, t, x, joints, coupling, modal, bias)

    @compiled_once("dq", "dv")
    def residual_jacobian(
        p: Vector, t: float, x: Vector, a: Vector, dq: Matrix, dv: Matrix
    ) -> None:
        interface.residual_jacobian(kernels, p, t, x, a, dq, dv)

    @compiled_once("force")
    def actuation(p: Vector, t: float, x: Vector, effort: Vector, force: Vector) -> None:
        interface.actuation(kernels, p, t, x, effort, force)

    @compiled_once("rate")
    def position_rates(p: Vector, t: float, x: Vector, rate: Vector) -> None:
        interface.position_rates(kernels, p, t, x, rate)

    return terms, residual_jacobian, actuation, position_rates


@cache
def rates_of(kernels: Kernels, m: int) -> Rates:
    """Return the state derivative and its Jacobian for compiled loops; m: joints."""

    @compiled_once("out")
    def rates(p: Vector, t: float, x: Vector, effort: Vector, out: Vector) -> None:
        slope = dynamics.derivative(kernels, p, t, x, effort, m)
        for k in range(out.size):
            out[k] = slope[k]

    return Rates(rates, _of_joints(kernels, m).jacobian)


@cache
def _advance(kernels: Kernels) -> Callable[..., None]:
    """Return the integration of a state of any size; m: entries of v before the modes."""
    solution = kernels.compiled.get("advance")
    if solution is not None:
        return _advance_exactly(solution)

    @compiled_once("x")
    def advance(
        p: Vector, t: float, effort: Vector, dt: float, steps: int, m: int, x: Vector
    ) -> None:
        n = (x.size - interface.extra(kernels)) // 2
        s = interface.square(kernels, n, m)
        blocks = dynamics.MassBlocks(np.empty((s, s)), np.empty((s, n - s)), np.empty(n - s))
        slopes, at, a = np.empty((dynamics.STAGES, x.size)), np.empty(x.size), np.empty(n)
        held = dynamics.HeldEffort(kernels, p, effort)
        work = dynamics.StepWork(slopes, at, a, blocks)
        dynamics.step_in_place(held, t, dt / steps, steps, n, x, work)

    return _in_parts(kernels, advance)


@cache
def _advance_exactly(solution: Callable[..., None]) -> Callable[..., None]:
    """Return the integration by an exact solution, one for all equations that have it."""

    @compiled_once("x")
    def advance(
        p: Vector, t: float, effort: Vector, dt: float, steps: int, m: int, x: Vector
    ) -> None:
        solution(p, t, effort, dt, x)

    return advance


def _in_parts(kernels: Kernels, advance: Callable[..., None]) -> Callable[..., None]:
    """Return an integration that takes apart what an acceleration jumps in; see next_jump.

    A jump at an edge of a part is next to it: no stage of a step sees its other side.
    """
    next_jump = kernels.compiled.get("next_jump")
    if next_jump is None:
        return advance

    @compiled_once("x")
    def advance_in_parts(
        p: Vector, t: float, effort: Vector, dt: float, steps: int, m: int, x: Vector
    ) -> None:
        near, begin, last = _JUMP_MARGIN * dt, t, t + dt
        if next_jump(p, t - near) >= last + near:
            advance(p, t, effort, dt, steps, m, x)
            return
        while begin < last:
            end = next_jump(p, begin + near)
            end = end if end < last - near else last
            advance(p, begin + near, effort, end - begin - 2.0 * near, steps, m, x)
            begin = end

    return advance_in_parts


@cache
def _of_any_size(kernels: Kernels, m: int) -> Bound:
    """Return kernels that are compiled once for all sizes; the author's own are called as is."""
    native, advance = kernels.compiled, _advance(kernels)

    def jacobian(p: Vector, t: float, x: Vector, effort: Vector, dx: Matrix, du: Matrix) -> None:
        dynamics.jacobian(kernels, p, t, x, effort, m, dx, du)

    return Bound(
        native["terms"],
        lambda p, t, x, effort: dynamics.derivative(kernels, p, t, x, effort, m),
        advance,
        jacobian,
        native["residual_jacobian"],
        lambda p, t, x: dynamics.energy(kernels, p, t, x, m),
        native["actuation"],
        native["kinematics"],
    )


@cache
def joint_reader(kernels: Kernels) -> Callable[[Vector, Matrix, Matrix, Matrix], None]:
    """Return what writes where joints are in many states and how fast, by kernels.reading."""
    native = kernels.compiled["reading"]

    @compiled_once("position", "velocity")
    def read(p: Vector, states: Matrix, position: Matrix, velocity: Matrix) -> None:
        for k in range(len(states)):
            native(p, states[k], position[k], velocity[k])

    return read
