"""The response of a model to efforts and a feedback, tick by tick as on the bench.

    c(k) = d(k) + feedback(x(k), r(k)),  x(k + 1) = f(x(k), e(k)),
with d the efforts that do not depend on the state, r the reference of the feedback, c the commands
and e the efforts of the motors.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple, TypeAlias, cast

import numpy as np
from numba import types

from flexslew_control.analysis.lti import Lti
from flexslew_control.planners.residual.motors import Matrices, matrices, motor_step
from flexslew_plant.arrays import Indices, Matrix, Tensor, Vector, compiled, compiled_once, put
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
# (x, row of the reference, gains, places, effort): adds to the effort, shape (joints,)
FeedbackLaw: TypeAlias = Callable[[Vector, Vector, Matrix, Indices, Vector], None]
feedback = compiled_once("effort")  # decorator of a FeedbackLaw


class FeedbackNumbers(NamedTuple):
    """What a feedback reads besides the state."""

    reference: Matrix  # a row for each tick
    gains: Matrix
    places: Indices  # of the measured entries in a state


class ClosedLoopResponse(NamedTuple):
    """The response of one model, tick by tick."""

    states: Matrix  # at the ticks, (ticks + 1, size)
    commands: Matrix  # efforts and feedback, (ticks, joints) [N m or N]
    applied: Matrix  # what the motors give, (ticks, joints) [N m or N]
    motors: Vector  # their states at the last tick, (s,)

    def tick_derivatives(
        self, model: Model, period: float, columns: Indices | None
    ) -> tuple[Tensor, Tensor]:
        """Return the exact derivatives of every tick's end, one step of the integrator.

        Args:
            model: that was simulated.
            period: one tick [s].
            columns: entries of a state by which they are taken; None: all.

        Returns:
            by its begin, (ticks, size, size), and by its effort, (ticks, size, joints).
        """
        ticks = len(self.applied)
        durations, one = np.full(ticks, period), np.ones(ticks, dtype=np.int64)
        return model.slopes_of_pieces(self.states[:-1], self.applied, durations, one, columns)


class _Tick(NamedTuple):
    """How a tick is integrated."""

    period: float  # [s]
    steps: int
    before_modes: int  # entries of v before the modes


def closed_loop(
    model: Model,
    start: Vector,
    inputs: Matrix,
    law: FeedbackLaw,
    numbers: FeedbackNumbers,
    motors: Lti,
    steps: int = 1,
) -> ClosedLoopResponse:
    """Return the response of a model.

    Args:
        model: equations of motion.
        start: state [q, v].
        inputs: efforts that no state changes, shape (ticks, joints) [N m or N].
        law: the feedback.
        numbers: of the feedback.
        motors: from commands to efforts, tick by tick.
        steps: of the integration, in every tick.
    """
    reference, gains = map(np.ascontiguousarray, numbers[:2])
    read = FeedbackNumbers(reference, gains, numbers.places)
    tick = _Tick(motors.period, steps, model.before_modes)
    given = model.packed, start, np.ascontiguousarray(inputs), matrices(motors)
    return ClosedLoopResponse(*_kernel()(model.integrate, law, read, *given, tick))


@lru_cache
def _kernel() -> Callable[..., tuple[Matrix, Matrix, Matrix, Vector]]:
    """Return _simulate as machine code, the same for all testbeds."""
    kernel: Any = compiled(_simulate)
    response = types.Tuple((_MATRIX, _MATRIX, _MATRIX, _VECTOR))
    numbers = types.NamedTuple((_MATRIX, _MATRIX, _PLACES), FeedbackNumbers)
    tick = types.NamedTuple((types.float64, types.int64, types.int64), _Tick)
    given = _VECTOR, _VECTOR, _MATRIX, types.UniTuple(_MATRIX, 4)
    kernel.compile(response(ADVANCE, _FEEDBACK, numbers, *given, tick))
    kernel.disable_compile()  # never for the type of one testbed's function
    return cast(Callable[..., tuple[Matrix, Matrix, Matrix, Vector]], kernel)


def _simulate(
    integrate: Callable[..., None],
    law: FeedbackLaw,
    numbers: FeedbackNumbers,
    p: Vector,
    start: Vector,
    inputs: Matrix,
    motors: Matrices,
    tick: _Tick,
) -> tuple[Matrix, Matrix, Matrix, Vector]:
    """Return states, commands, efforts and the motors' states; p: the model's parameters."""
    ticks, m = inputs.shape
    path, x, u = np.empty((ticks + 1, start.size)), start.copy(), np.empty(m)
    commands, applied = np.empty((ticks, m)), np.empty((ticks, m))
    z = np.zeros(len(motors[0]))
    put(x, path[0])
    for k in range(ticks):
        put(inputs[k], u)
        law(x, numbers.reference[k], numbers.gains, numbers.places, u)
        put(u, commands[k])
        motor_step(motors, z, u)
        put(u, applied[k])
        integrate(p, k * tick.period, u, tick.period, tick.steps, tick.before_modes, x)
        put(x, path[k + 1])
    return path, commands, applied, z
