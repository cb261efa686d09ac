"""A testbed's equations of motion run on a tape: its slopes, and whole steps of a scheme."""

import types
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.compiled import mass
from flexslew_plant.testbeds.compiled.nystrom import Nystrom
from flexslew_plant.testbeds.compiled.tape import Number, Tape, Value
from flexslew_plant.testbeds.kernels import select
from flexslew_plant.testbeds.model import Model


class TracedEquations:
    """[q', M^-1 (B u - h)] of a testbed, for numbers on a tape.

    Args:
        model: of one testbed; what else has the same packed zeros and tape.fixed shares the tape.
    """

    def __init__(self, model: Model) -> None:
        self.tape = Tape(model.packed)
        self._kernels, self._n, self._m = model.kernels, model.coordinates, model.before_modes
        self._p = self.tape.parameters()
        self._traced: dict[Any, Any] = {}
        self._step_starts: dict[
            int, Any
        ] = {}  # coordinates of a stage: those at the start of the step
        self.x = _array([self.tape.input("x", k) for k in range(model.positions + self._n)])
        self.u = _array([self.tape.input("u", k) for k in range(model.efforts)])
        self._joints = model.joints
        self._numpy = _Numpy(self.tape, self._step_start_of)

    def slopes(self, t: Value, x: Any) -> Any:
        """Return the slopes of a state at time t, shape of x.

        Raises:
            Untraceable: the equations branch on more than packed numbers.
        """
        functions, n, p = self._kernels.functions, self._n, self._p
        rate = _zeros(len(x))
        if "kinematics" in functions:
            self._run(functions["kinematics"], p, t, x, rate)
        else:
            rate[:n] = x[n:]
        rate[len(x) - n :] = self.acceleration(t, x)
        return rate

    def acceleration(self, t: Value, x: Any) -> Any:
        """Return M^-1 (B u - h) of a state at time t, shape (n,)."""
        functions, n, m, p = self._kernels.functions, self._n, self._m, self._p
        if "acceleration" in functions:
            out = _zeros(n)
            self._run(functions["acceleration"], p, t, x, self.u, out)
            return out
        s = n if self._kernels.full_mass else m
        joints, coupling = _zeros((s, s)), _zeros((s, n - s))
        modal, out = _zeros(n - s), _zeros(n)
        blocks = (joints, out) if self._kernels.full_mass else (joints, coupling, modal, out)
        self._run(functions["terms"], p, t, x, *blocks)
        for k in range(n):
            out[k] = 0.0 - out[k]
        if "actuation" in functions:
            self._run(functions["actuation"], p, t, x, self.u, out)
        else:
            out[: len(self.u)] += self.u
        self._run(mass.factor, joints, coupling, modal)
        self._run(mass.solve, joints, coupling, modal, out)
        return out

    def joints(self) -> list[Value]:
        """Return position and rate of the joints by the `reading` of the equations."""
        position, rate = _zeros(self._joints), _zeros(self._joints)
        self._run(self._kernels.functions["reading"], self._p, self.x, position, rate)
        return [*position, *rate]

    def step(self, t: Value, h: Value, weights: Matrix, times: Vector) -> Any:
        """Return the state after a step of an explicit Runge-Kutta scheme.

        Args:
            t: at its start.
            h: its length.
            weights: a_ij, the last row those of the result, shape (stages + 1, stages).
            times: of the stages, shape (stages,).
        """
        slopes: list[Any] = []
        x = self.x
        for row, time in zip(weights, [*times, 1.0], strict=True):
            x = self.x.copy()
            for weight, slope in zip(row, slopes, strict=False):
                if weight != 0.0:
                    x = x + slope * (h * float(weight))
            if len(slopes) < len(times):
                slopes.append(self.slopes(t + h * float(time), x))
        return x

    def nystrom_step(self, t: Value, h: Value, scheme: Nystrom) -> list[Any]:
        """Return the accelerations of all stages of a scheme for q' = v, then the state after.

        Args:
            t: at its start.
            h: its length.
            scheme: its weights.
        """
        n, times = self._n, scheme.times
        q, v = self.x[:n], self.x[n:]
        found: list[Any] = []
        x = self.x
        for i, time in enumerate([*times, 1.0]):
            place, rate = q + v * (h * float(time)), v
            for a, of_place, of_rate in zip(
                found, scheme.of_place[i], scheme.of_rate[i], strict=False
            ):
                place = place + a * (h * h * float(of_place)) if of_place else place
                rate = rate + a * (h * float(of_rate)) if of_rate else rate
            x = _array([*place, *rate]) if i else self.x
            if i < len(times):
                self._step_starts = {
                    new.index: old for new, old in zip(place, q, strict=True) if new is not old
                }
                found.append(self.acceleration(t + h * float(time), x))
        self._step_starts = {}
        return [*found, x]

    def _step_start_of(self, angle: Value) -> Value:
        """Return the coordinate at the start of a step that has become this one; None: unknown."""
        return self._step_starts.get(angle.index) if isinstance(angle, Number) else None

    def _run(self, function: Any, *given: Any) -> None:
        _trace_function(self._numpy, self._traced, function)(*given)


def _array(values: list[Any]) -> Any:
    found = np.empty(len(values), dtype=object)
    found[:] = values
    return found


def _zeros(shape: Any) -> Any:
    return np.full(shape, 0.0, dtype=object)


class _Numpy:
    """The part of NumPy that equations use, on numbers that take notes."""

    def __init__(self, tape: Tape, step_start_of: Callable[[Value], Value]) -> None:
        self.operation = one = tape.operation
        self.sqrt, self._step_start_of = partial(one, "sqrt"), step_start_of
        self.arctan2 = partial(one, "arctan2")
        self.empty = self.zeros = _zeros
        self.pi = np.pi

    def sin(self, angle: Value) -> Value:
        """Note a sine."""
        return self._trace_angle("sine", angle)

    def cos(self, angle: Value) -> Value:
        """Note a cosine."""
        return self._trace_angle("cosine", angle)

    def _trace_angle(self, name: str, angle: Value) -> Value:
        """Note it by what the angle has turned since the step began, where that is known."""
        start = self._step_start_of(angle)
        if start is None:
            return self.operation(name, angle)
        before = self.operation("sine", start), self.operation("cosine", start)
        return self.operation(name, *before, angle - start)


def _trace_function(numpy: _Numpy, known: dict[Any, Any], function: Any) -> Callable[..., Any]:
    """Return a function, and all that it calls, for numbers that take notes."""
    if function is select:
        return partial(numpy.operation, "where")
    plain = getattr(function, "py_func", function)
    if plain not in known:
        names = dict(plain.__globals__)
        copy = types.FunctionType(
            plain.__code__, names, plain.__name__, plain.__defaults__, plain.__closure__
        )
        known[plain] = copy
        for name in plain.__code__.co_names:
            value = names.get(name)
            if value is np:
                names[name] = numpy
            elif hasattr(value, "py_func"):
                names[name] = _trace_function(numpy, known, value)
    found: Callable[..., Any] = known[plain]
    return found
