"""Parameters of a testbed's own equations from a record, by prediction error.

The bench's non-linear equations are flown with the efforts that were really applied, held over
every tick. The readings of the sensors differ from that flight by their noise, a bias and the
motion of the bench before the record; the last two are eliminated (variable projection on the free
motions of the bench). The efforts are known exactly, so the feedback that made them biases nothing.
Slopes are those of the flight as it is computed, by its variational equations; the covariance is
the inverse of Fisher's information (Ljung 1999, chapter 9).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares, linear_sum_assignment

from flexslew_lab.identification.flights import FlightSimulation, Mismatch
from flexslew_lab.identification.modal.modes import Interval, ModalModel, interval
from flexslew_lab.trial.overrides import override_values
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import flat, plain
from flexslew_plant.testbeds import Testbed, initial_positions

_MAX_ITERATIONS = 12
_CONVERGED = 1e-2  # of a step, in standard deviations; flights round at some 5e-3 of them
_MAX_CORRELATION = 0.99  # correlation from which two parameters cannot be separated
_RANK_TOLERANCE = 1e-12  # eigenvalue of the scaled information below which rounding dominates
_UNKNOWN = 0.5  # relative standard deviation from which a parameter is not known at all
_LIGHT = 0.1  # weight of damping and inertia relative to frequencies, for a start
_PREFIX = "testbed."


class Parameter(NamedTuple):
    """A number of a testbed's section."""

    key: str  # its path, `parameters.bending_stiffness`
    value: Interval


@dataclass(frozen=True)
class PhysicalFit:
    """Parameters with their covariance.

    Args:
        parameters: parameters in the requested order.
        correlation: their correlation, (parameters, parameters).
        warnings: parameters that cannot be separated, or are not known.
        noise: standard deviation of the residual of every output, (outputs,).
        flights: number of flights.
    """

    parameters: tuple[Parameter, ...]
    correlation: Matrix
    warnings: tuple[str, ...]
    noise: Vector
    flights: int

    @property
    def changes(self) -> dict[str, Any]:
        """The keys of the testbed's section that were found, nested."""
        return override_values({}, {p.key: p.value.value for p in self.parameters})


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
    report = progress or (lambda words: None)
    names = tuple(key.removeprefix(_PREFIX) for key in keys)
    first = _values(testbed, names)
    problem = FlightSimulation(found.record, testbed, names)
    start = _by_modes(found, problem, first)
    report(f"parameters from the modes: {_words(names, start)}")
    now, noise = start, found.fit.noise
    state = problem.solve(now, noise)
    for number in range(1, _MAX_ITERATIONS + 1):
        slopes = problem.slopes(now, state, noise)
        information = slopes.T @ slopes
        step = np.asarray(
            np.linalg.lstsq(information, slopes.T @ state.residual, rcond=1e-14)[0],
            dtype=np.float64,
        )
        step_deviation = float(np.sqrt(abs(step @ information @ step)))
        now, state = _along(problem, now, step, state, noise)
        noise = problem.noise_of(state, noise)
        state = problem.solve(now, noise)
        report(f"flight {problem.flights}, round {number}: {_words(names, now)}")
        if step_deviation < _CONVERGED:
            break
    covariance = _covariance(information)
    spread = np.sqrt(np.diag(covariance))
    safe = np.where(spread > 0.0, spread, 1.0)
    correlation = covariance / np.outer(safe, safe)
    parameters = tuple(
        Parameter(key, interval(float(np.exp(v)), float(np.exp(v) * s)))
        for key, v, s in zip(names, now, spread, strict=True)
    )
    warnings = _warnings(names, correlation, spread)
    return PhysicalFit(parameters, correlation, warnings, noise, problem.flights)


def _covariance(information: Matrix) -> Matrix:
    """Return the inverse; a direction without information gets a very large variance."""
    size = np.sqrt(np.diag(information))
    size = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    scaled = (vectors / np.maximum(values, _RANK_TOLERANCE)) @ vectors.T
    return np.asarray(scaled / np.outer(size, size))


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


def _along(
    problem: FlightSimulation, now: Vector, step: Vector, state: Mismatch, noise: Vector
) -> tuple[Vector, Mismatch]:
    """Return the parameters after a step, halved until the residual falls."""
    cost = state.residual @ state.residual
    for share in 0.5 ** np.arange(8):
        candidate = problem.solve(now + share * step, noise)
        if candidate.residual @ candidate.residual <= cost * (1.0 + 1e-12):
            return now + share * step, candidate
    return now, state


def _by_modes(found: ModalModel, problem: FlightSimulation, first: Vector) -> Vector:
    """Return the parameters that give small motions the modes and the inertia found."""
    if not found.modes:
        return first
    requested = np.array([[m.frequency.value, m.damping_ratio.value] for m in found.modes])
    inertia = np.array([[entry.value for entry in row] for row in found.inertia])

    def mismatch(values: Vector) -> Vector:
        testbed = problem.testbed(values)
        model = testbed.model()
        linear = model.linearise(model.rest(initial_positions(testbed)))
        poles = linear.eigenvalues
        poles = poles[poles.imag > 1e-6]
        w, zeta = np.abs(poles), -poles.real / np.abs(poles)
        requested_rows, model_rows = linear_sum_assignment(np.abs(np.log(requested[:, :1] / w)))
        parts = [
            np.log(w[model_rows] / requested[requested_rows, 0]),
            _LIGHT * (zeta[model_rows] - requested[requested_rows, 1]),
        ]
        if inertia.size:
            rigid = linear.mass[: model.before_modes, : model.before_modes]
            input_matrix = linear.input_matrix[: model.before_modes, problem.inputs]
            effective_inertia = np.linalg.inv(input_matrix.T @ np.linalg.solve(rigid, input_matrix))
            parts.append((_LIGHT * (effective_inertia - inertia) / np.diag(inertia).mean()).ravel())
        return np.concatenate(parts)

    return np.asarray(least_squares(mismatch, first, jac="3-point").x)


def _warnings(names: tuple[str, ...], correlation: Matrix, spread: Vector) -> tuple[str, ...]:
    """Return which parameters the record cannot separate, or does not determine."""
    words = []
    for i, name in enumerate(names):
        if not 0.0 < spread[i] < _UNKNOWN:
            words.append(f"{name} is not known from this record (+-{spread[i]:.0%})")
        words += [
            f"{names[j]} and {name} cannot be distinguished (correlation {correlation[i, j]:.4f}); "
            "fit one of them"
            for j in range(i)
            if abs(correlation[i, j]) > _MAX_CORRELATION
        ]
    return tuple(words)
