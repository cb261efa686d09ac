"""Flights of a testbed's own equations with the efforts of a record, against what was measured."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from flexslew_lab.identification.modal.oscillators import oscillators_of
from flexslew_lab.identification.modal.projection import Projection
from flexslew_lab.identification.records.record import Quantity, Record
from flexslew_lab.trial.overrides import override_values
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import Model, Testbed, initial_state, with_changes

_STEP = 2.0**-8  # relative, of differences of what is algebraic


@dataclass(frozen=True)
class Mismatch:
    """A flight against the record, in standard deviations."""

    residual: Vector
    projections: tuple[Projection, ...]


class FlightSimulation:
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
        return with_changes(self._testbed, override_values({}, keys), "--fit")

    def simulate(self, values: Vector) -> Matrix:
        """Return the readings of the sensors without errors, (ticks + 1, outputs)."""
        self.flights += 1
        testbed = self.testbed(values)
        model = testbed.model()
        start = initial_state(testbed)
        path = model.path(start, self._effort, self.record.period)
        return self._rows(model, np.vstack((start, path)))

    def solve(self, values: Vector, noise: Vector) -> Mismatch:
        """Return the residual of a flight without bias and free motions."""
        model = self.testbed(values).model()
        free = _free_responses(self.record, model)
        error = self.record.measured - self.simulate(values)
        parts, projections = [], []
        for k, output in enumerate(self.record.outputs):
            projection = Projection(_unit(free[output.quantity]))
            parts.append(projection.solve(error[:, k])[1] / noise[k])
            projections.append(projection)
        return Mismatch(np.concatenate(parts), tuple(projections))

    def slopes(self, values: Vector, state: Mismatch, noise: Vector) -> Matrix:
        """Return d(flown)/d(log parameter) without what bias and free motions explain.

        A parameter is one column; exact, see sensitivities.
        """
        columns = []
        for slope in self.sensitivities(values):
            parts = [
                projection.solve(slope[:, o])[1] / noise[o]
                for o, projection in enumerate(state.projections)
            ]
            columns.append(np.concatenate(parts))
        return np.column_stack(columns)

    def sensitivities(self, values: Vector) -> list[Matrix]:
        """Return d(flown)/d(log parameter) of each, (ticks + 1, outputs).

        States follow the variational equations, with steps of the same integrator. Differences
        are taken of algebraic maps alone, from parameters to the numbers of the equations and from
        states to readings, with an error of order 4 that is below rounding.
        """
        self.flights += 1
        testbed, record = self.testbed(values), self.record
        each = range(values.size)
        path, path_slopes = testbed.model().flight_with_slopes(
            initial_state(testbed),
            np.array([self._slope(values, k, lambda near, _: initial_state(near)) for k in each]),
            np.array([self._slope(values, k, lambda near, _: near.model().packed) for k in each]),
            self._effort,
            record.period,
        )

        def seen(by: Matrix) -> Callable[[Testbed, float], Matrix]:
            return lambda near, h: self._rows(near.model(), path + h * by)

        return [self._slope(values, k, seen(path_slopes[:, k])) for k in each]

    def _slope(
        self, values: Vector, which: int, what: Callable[[Testbed, float], Matrix]
    ) -> Matrix:
        """Return how something smooth changes with a parameter: Romberg's differences, order 4.

        Args:
            values: logarithms of the parameters.
            which: of them changes.
            what: of the testbed with that one larger by a number, and of the number.
        """

        def difference(h: float) -> Matrix:
            step = h * np.eye(values.size)[which]
            forward, backward = self.testbed(values + step), self.testbed(values - step)
            return np.asarray((what(forward, h) - what(backward, -h)) / (2.0 * h))

        return np.asarray((4.0 * difference(0.5 * _STEP) - difference(_STEP)) / 3.0)

    def noise_of(self, state: Mismatch, noise: Vector) -> Vector:
        """Return the standard deviation of every output's residual."""
        each = state.residual.reshape(len(self.record.outputs), -1)
        found = noise * np.sqrt((each**2).mean(axis=1))
        return np.asarray(np.maximum(found, 1e-12 * np.abs(self.record.measured).max(axis=0)))


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
        selected = []
        for output in record.outputs:
            values, places = columns[output.quantity]
            selected.append(values[:, places[output.joint or output.name]])
        return np.column_stack(selected)

    return read


def _free_responses(record: Record, model: Model) -> dict[Quantity, Matrix]:
    """Return bias and the small motions that the bench may have had before, by quantity."""
    t = record.times
    one, line = np.ones_like(t), t / record.duration
    linear = model.linearise(model.rest({}))
    poles = linear.eigenvalues
    poles = poles[poles.imag > 1e-6]
    no_effort = np.zeros((record.ticks, 0))
    free = [mode.responses(no_effort, record.period) for mode in oscillators_of(poles)]
    positions, rates = [q for q, _ in free], [v for _, v in free]
    return {
        Quantity.JOINT_POSITION: np.column_stack((one, line, *positions)),
        Quantity.JOINT_RATE: np.column_stack((one, *rates)),
        Quantity.DEFLECTION: np.column_stack((one, *positions)),
        Quantity.DEFLECTION_RATE: np.column_stack((one, *rates)),
    }


def _unit(columns: Matrix) -> Matrix:
    return np.asarray(columns / np.sqrt(np.einsum("ij,ij->j", columns, columns)))
