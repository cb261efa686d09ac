"""The flight of a member under efforts and feedback, tick by tick, as a kernel.

    c(k) = d(k) + feedback(x(k), r(k)),  x(k + 1) = f(x(k), e(k)),
with d the efforts that do not depend on the member's state, r what the feedback compares it with,
c what is commanded and e what the motors give of it.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, TypeAlias, cast

import numpy as np
from numba import types

from flexslew_control.analysis.lti import Lti
from flexslew_control.planners.minimax.motion import MemberFlight
from flexslew_control.planners.residual.motors import Matrices, matrices, motor_step
from flexslew_plant.arrays import Indices, Matrix, Vector, compiled, compiled_once, put
from flexslew_plant.machine_code.read_only import read_only
from flexslew_plant.testbeds import Model
from flexslew_plant.testbeds.compiled.bound import ADVANCE

_VECTOR, _MATRIX = types.Array(types.float64, 1, "C"), types.Array(types.float64, 2, "C")
_PLACES = types.Array(types.int64, 1, "C")
_FEEDBACK = types.FunctionType(
    types.void(
        read_only(_VECTOR), read_only(_VECTOR), read_only(_MATRIX), read_only(_PLACES), _VECTOR
    )
)
# (x, reference, gains, where x holds what is fed back, effort): adds to the effort, (joints,)
MemberFeedback: TypeAlias = Callable[[Vector, Vector, Matrix, Indices, Vector], None]
feedback = compiled_once("effort")  # makes a function one that closed_loop takes


def closed_loop(
    model: Model,
    start: Vector,
    inputs: Matrix,
    feedback_law: MemberFeedback,
    reference: Matrix,
    gains: Matrix,
    places: Indices,
    motors: Lti,
) -> MemberFlight:
    """Return the flight of a member.

    Args:
        model: equations of motion.
        start: state [q, v].
        inputs: efforts that no state changes, shape (ticks, joints) [N m or N].
        feedback_law: the feedback.
        reference: what it compares a state with, a row for each tick.
        gains: of the feedback.
        places: where a state holds what is fed back.
        motors: from commands to efforts, tick by tick.
    """
    arrays = map(np.ascontiguousarray, (inputs, reference, gains))
    given = model.integrate, feedback_law, model.packed, start, *arrays, places
    return MemberFlight(*_kernel()(*given, matrices(motors), motors.period, model.before_modes))


@lru_cache
def _kernel() -> Callable[..., tuple[Matrix, Matrix, Matrix, Vector]]:
    """Return _flown as machine code, the same for all testbeds."""
    kernel: Any = compiled(_simulate)
    found = types.Tuple((_MATRIX, _MATRIX, _MATRIX, _VECTOR))
    given = _VECTOR, _VECTOR, _MATRIX, _MATRIX, _MATRIX, _PLACES
    motors = types.UniTuple(_MATRIX, 4)
    kernel.compile(found(ADVANCE, _FEEDBACK, *given, motors, types.float64, types.int64))
    kernel.disable_compile()  # never for the type of one testbed's function
    return cast(Callable[..., tuple[Matrix, Matrix, Matrix, Vector]], kernel)


def _simulate(
    integrate: Callable[..., None],
    feedback_law: Callable[..., None],
    p: Vector,
    start: Vector,
    inputs: Matrix,
    reference: Matrix,
    gains: Matrix,
    places: Indices,
    motors: Matrices,
    period: float,
    before_modes: int,
) -> tuple[Matrix, Matrix, Matrix, Vector]:
    """Return states, commands, efforts and the motors' states."""
    ticks, m = inputs.shape
    path, x, u = np.empty((ticks + 1, start.size)), start.copy(), np.empty(m)
    commands, applied = np.empty((ticks, m)), np.empty((ticks, m))
    z = np.zeros(len(motors[0]))
    put(x, path[0])
    for k in range(ticks):
        put(inputs[k], u)
        feedback_law(x, reference[k], gains, places, u)
        put(u, commands[k])
        motor_step(motors, z, u)
        put(u, applied[k])
        integrate(p, k * period, u, period, 1, before_modes, x)
        put(x, path[k + 1])
    return path, commands, applied, z
