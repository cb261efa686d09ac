"""Parameters of a testbed's own equations from a record, by prediction error.

The bench's non-linear equations are flown with the efforts that were really applied, held over
every tick. What the sensors say differs from that flight by their noise, a bias and the motion that
the bench had before the record; the last two are eliminated (variable projection on the free
motions of the bench). The efforts are known exactly, so the feedback that made them biases nothing.
Slopes are central differences of whole flights by an integrator of order 8, with an error of 1e-8
of a slope; the covariance is the inverse of Fisher's information (Ljung 1999, chapter 9).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple, cast

import numpy as np
from numba import types
from scipy.optimize import least_squares, linear_sum_assignment

from flexslew_lab.identification.modal_fit import Projection
from flexslew_lab.identification.modes import Interval, ModalModel, interval
from flexslew_lab.identification.oscillators import Oscillator, times
from flexslew_lab.identification.record import Quantity, Record
from flexslew_plant.arrays import Matrix, Vector, compiled
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import flat, plain
from flexslew_plant.testbeds import Model, Testbed, initial_positions, initial_state, varied
from flexslew_plant.testbeds.compiled.bound import ADVANCE

_STEP = 1e-5  # relative, of the central differences
_ROUNDS = 12
_CONVERGED = 1e-3  # of a step, in standard deviations
_ALIKE = 0.99  # correlation from which two parameters cannot be told apart
_UNKNOWN = 0.5  # relative standard deviation from which a parameter is not known at all
_LIGHT = 0.1  # weight of damping and inertia beside the frequencies, for a start
_PREFIX = "testbed."


class Parameter(NamedTuple):
    """A number of a testbed's section."""

    key: str  # its path, `parameters.bending_stiffness`
    value: Interval


@dataclass(frozen=True)
class PhysicalFit:
    """Parameters with their covariance.

    Args:
        parameters: in the order they were asked for.
        correlation: (parameters, parameters).
        warnings: what cannot be told apart, or at all.
        noise: standard deviation of the residual of every output, (outputs,).
        flights: how many were flown.
    """

    parameters: tuple[Parameter, ...]
    correlation: Matrix
    warnings: tuple[str, ...]
    noise: Vector
    flights: int

    @property
    def changes(self) -> dict[str, Any]:
        """The keys of the testbed's section that were found, nested."""
        return nested({p.key: p.value.value for p in self.parameters})


def fit_parameters(
    found: ModalModel,
    testbed: Testbed,
    keys: tuple[str, ...],
    progress: Callable[[str], None] | None = None,
) -> PhysicalFit:
    """Return parameters of a testbed that explain a record.

    It starts where the testbed's small motions have the frequencies, the damping and the inertia
    that were found, so that 20 % of error in a stiffness do not lose the phase of a long record.

    Args:
        found: modes of the record.
        testbed: that stands on the bench, with first values of the parameters.
        keys: paths of numbers in its section; a leading `testbed.` may stand there.
        progress: called with what is being done.

    Raises:
        BadInput: a key is no number of the testbed, or no flight explains the record.
    """
    tell = progress or (lambda words: None)
    names = tuple(key.removeprefix(_PREFIX) for key in keys)
    first = _values(testbed, names)
    problem = _Problem(found.record, testbed, names)
    start = _by_modes(found, problem, first)
    tell(f"parameters from the modes: {_words(names, start)}")
    now, noise = start, found.fit.noise
    state = problem.solve(now, noise)
    for number in range(1, _ROUNDS + 1):
        slopes = problem.slopes(now, state, noise)
        information = slopes.T @ slopes
        step = np.asarray(
            np.linalg.lstsq(information, slopes.T @ state.residual, rcond=1e-14)[0],
            dtype=np.float64,
        )
        deviations = float(np.sqrt(abs(step @ information @ step)))
        now, state = _along(problem, now, step, state, noise)
        noise = problem.noise_of(state, noise)
        state = problem.solve(now, noise)
        tell(f"flight {problem.flights}, round {number}: {_words(names, now)}")
        if deviations < _CONVERGED:
            break
    covariance = np.linalg.pinv(information, hermitian=True)
    spread = np.sqrt(np.diag(covariance))
    safe = np.where(spread > 0.0, spread, 1.0)
    correlation = covariance / np.outer(safe, safe)
    parameters = tuple(
        Parameter(key, interval(float(np.exp(v)), float(np.exp(v) * s)))
        for key, v, s in zip(names, now, spread, strict=True)
    )
    warnings = _warnings(names, correlation, spread)
    return PhysicalFit(parameters, correlation, warnings, noise, problem.flights)


def nested(paths: dict[str, Any]) -> dict[str, Any]:
    """Return values by dotted path as nested keys."""
    out: dict[str, Any] = {}
    for path, value in paths.items():
        *outer, last = path.split(".")
        place = out
        for part in outer:
            place = place.setdefault(part, {})
        place[last] = value
    return out


def _values(testbed: Testbed, names: tuple[str, ...]) -> Vector:
    """Return the logarithms of the first values."""
    known = flat(plain(testbed))
    numbers = {
        key: value
        for key, value in known.items()
        if isinstance(value, int | float) and not isinstance(value, bool)
    }
    for name in names:
        if name not in numbers:
            allowed = ", ".join(key for key, value in numbers.items() if value)
            raise BadInput(f"--fit: {name} is not a number of the testbed; allowed: {allowed}")
        if not numbers[name] > 0.0:
            raise BadInput(
                f"--fit: {name}: {numbers[name]:g} is no start: give it a value above 0 "
                f"(--start {name}=VALUE)"
            )
    return np.log([float(numbers[name]) for name in names])


def _words(names: tuple[str, ...], values: Vector) -> str:
    return ", ".join(f"{n} {np.exp(v):.6g}" for n, v in zip(names, values, strict=True))


@dataclass(frozen=True)
class _State:
    """A flight against the record, in standard deviations."""

    residual: Vector
    projections: tuple[Projection, ...]


class _Problem:
    """Flights of a testbed with the efforts of a record."""

    def __init__(self, record: Record, testbed: Testbed, names: tuple[str, ...]) -> None:
        self.record, self._testbed, self._names = record, testbed, names
        self.flights = 0
        model = testbed.model()
        self.inputs = [model.joint_names.index(name) for name in record.inputs]
        self._effort = np.zeros((record.ticks, model.efforts))
        self._effort[:, self.inputs] = record.effort
        self._rows = _reading(record, model)

    def testbed(self, values: Vector) -> Testbed:
        """Return the testbed with these logarithms of its parameters."""
        keys = dict(zip(self._names, np.exp(values).tolist(), strict=True))
        return varied(self._testbed, nested(keys), "--fit")

    def flown(self, values: Vector) -> Matrix:
        """Return what the sensors would say without errors, (ticks + 1, outputs)."""
        self.flights += 1
        testbed = self.testbed(values)
        model = testbed.model()
        start = initial_state(testbed)
        path = _kernel()(
            model.integrate,
            model.packed,
            start,
            self._effort,
            self.record.period,
            model.before_modes,
        )
        return self._rows(model, path)

    def solve(self, values: Vector, noise: Vector) -> _State:
        """Return the residual of a flight without bias and free motions."""
        model = self.testbed(values).model()
        free = _free_motions(self.record, model)
        away = self.record.measured - self.flown(values)
        parts, projections = [], []
        for k, output in enumerate(self.record.outputs):
            projection = Projection(_unit(free[output.quantity]))
            parts.append(projection.solve(away[:, k])[1] / noise[k])
            projections.append(projection)
        return _State(np.concatenate(parts), tuple(projections))

    def slopes(self, values: Vector, state: _State, noise: Vector) -> Matrix:
        """Return d(flown)/d(log parameter) without what bias and free motions explain."""
        columns = []
        for k in range(values.size):
            step = np.zeros(values.size)
            step[k] = _STEP
            slope = (self.flown(values + step) - self.flown(values - step)) / (2.0 * _STEP)
            parts = [
                projection.solve(slope[:, o])[1] / noise[o]
                for o, projection in enumerate(state.projections)
            ]
            columns.append(np.concatenate(parts))
        return np.column_stack(columns)

    def noise_of(self, state: _State, noise: Vector) -> Vector:
        """Return the standard deviation of every output's residual."""
        each = state.residual.reshape(len(self.record.outputs), -1)
        found = noise * np.sqrt((each**2).mean(axis=1))
        return np.asarray(np.maximum(found, 1e-12 * np.abs(self.record.measured).max(axis=0)))


def _along(
    problem: _Problem, now: Vector, step: Vector, state: _State, noise: Vector
) -> tuple[Vector, _State]:
    """Return the parameters after a step, halved until the residual falls."""
    cost = state.residual @ state.residual
    for share in 0.5 ** np.arange(8):
        tried = problem.solve(now + share * step, noise)
        if tried.residual @ tried.residual <= cost * (1.0 + 1e-12):
            return now + share * step, tried
    return now, state


def _by_modes(found: ModalModel, problem: _Problem, first: Vector) -> Vector:
    """Return the parameters whose small motions have the modes and the inertia found."""
    if not found.modes:
        return first
    wanted = np.array([[m.frequency.value, m.damping_ratio.value] for m in found.modes])
    inertia = np.array([[entry.value for entry in row] for row in found.inertia])

    def mismatch(values: Vector) -> Vector:
        testbed = problem.testbed(values)
        model = testbed.model()
        linear = model.linearise(model.rest(initial_positions(testbed)))
        poles = linear.eigenvalues
        poles = poles[poles.imag > 1e-6]
        w, zeta = np.abs(poles), -poles.real / np.abs(poles)
        mine, theirs = linear_sum_assignment(np.abs(np.log(wanted[:, :1] / w)))
        parts = [
            np.log(w[theirs] / wanted[mine, 0]),
            _LIGHT * (zeta[theirs] - wanted[mine, 1]),
        ]
        if inertia.size:
            rigid = linear.mass[: model.before_modes, : model.before_modes]
            pushed = linear.input_matrix[: model.before_modes, problem.inputs]
            felt = np.linalg.inv(pushed.T @ np.linalg.solve(rigid, pushed))
            parts.append((_LIGHT * (felt - inertia) / np.diag(inertia).mean()).ravel())
        return np.concatenate(parts)

    return np.asarray(least_squares(mismatch, first, jac="3-point").x)


def _reading(record: Record, model: Model) -> Callable[[Model, Matrix], Matrix]:
    """Return what turns the states of a flight into the outputs of the record."""
    joints = {name: k for k, name in enumerate(model.joint_names)}
    tips = {f"tip.{name}": k for k, name in enumerate(model.appendages.names)}
    for output in record.outputs:
        if not output.joint and output.name not in tips:
            raise BadInput(f"{record.source}: {output.name} is no sensor of the testbed")

    def read(now: Model, path: Matrix) -> Matrix:
        if now.reading is None:
            n = now.positions
            position, rate = path[:, : now.joints], path[:, n : n + now.joints]
        else:
            pairs = [now.joint_state(x) for x in path]
            position, rate = (np.array([pair[k] for pair in pairs]) for k in (0, 1))
        first = now.positions - now.modes
        modes, rates = path[:, first : now.positions], path[:, now.positions + now.before_modes :]
        deflection = modes @ now.appendages.tip.T
        if now.appendages.rate is not None:
            deflection = deflection + rates @ now.appendages.rate.T
        columns = {
            Quantity.JOINT_POSITION: (position, joints),
            Quantity.JOINT_RATE: (rate, joints),
            Quantity.DEFLECTION: (deflection, tips),
            Quantity.DEFLECTION_RATE: (deflection, tips),
        }
        picked = []
        for output in record.outputs:
            values, places = columns[output.quantity]
            picked.append(values[:, places[output.joint or output.name]])
        return np.column_stack(picked)

    return read


def _free_motions(record: Record, model: Model) -> dict[Quantity, Matrix]:
    """Return bias and the small motions that the bench may have had before, by quantity."""
    t = times(record.ticks, record.period)
    one, line = np.ones_like(t), t / record.duration
    linear = model.linearise(model.rest({}))
    poles = linear.eigenvalues
    poles = poles[poles.imag > 1e-6]
    free = [
        Oscillator(float(abs(s)), float(-s.real / abs(s))).free(record.ticks, record.period)
        for s in poles
    ]
    size = [np.array([1.0, abs(s)]) for s in poles]
    moves = [q * scale for (q, _), scale in zip(free, size, strict=True)]
    rates = [v * scale for (_, v), scale in zip(free, size, strict=True)]
    return {
        Quantity.JOINT_POSITION: np.column_stack((one, line, *moves)),
        Quantity.JOINT_RATE: np.column_stack((one, *rates)),
        Quantity.DEFLECTION: np.column_stack((one, *moves)),
        Quantity.DEFLECTION_RATE: np.column_stack((one, *rates)),
    }


def _unit(columns: Matrix) -> Matrix:
    return np.asarray(columns / np.sqrt(np.einsum("ij,ij->j", columns, columns)))


def _warnings(names: tuple[str, ...], correlation: Matrix, spread: Vector) -> tuple[str, ...]:
    """Return which parameters the record cannot tell apart, or does not know."""
    words = []
    for i, name in enumerate(names):
        if not 0.0 < spread[i] < _UNKNOWN:
            words.append(f"{name} is not known from this record (+-{spread[i]:.0%})")
        words += [
            f"{names[j]} and {name} cannot be told apart (correlation {correlation[i, j]:.4f}); "
            "fit one of them"
            for j in range(i)
            if abs(correlation[i, j]) > _ALIKE
        ]
    return tuple(words)


@lru_cache
def _kernel() -> Callable[..., Matrix]:
    """Return _flown as machine code, the same for all testbeds."""
    vector, matrix = types.Array(types.float64, 1, "C"), types.Array(types.float64, 2, "C")
    kernel: Any = compiled(_flown)
    kernel.compile(matrix(ADVANCE, vector, vector, matrix, types.float64, types.int64))
    kernel.disable_compile()  # never for the type of one testbed's function
    return cast(Callable[..., Matrix], kernel)


def _flown(
    advance: Callable[..., None],
    p: Vector,
    start: Vector,
    effort: Matrix,
    period: float,
    before_modes: int,
) -> Matrix:
    """Return the states at the ticks, shape (ticks + 1, size of a state)."""
    path, x = np.empty((effort.shape[0] + 1, start.size)), start.copy()
    path[0] = x
    for k in range(effort.shape[0]):
        advance(p, k * period, effort[k], period, 1, before_modes, x)
        path[k + 1] = x
    return path
