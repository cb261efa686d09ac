"""The plant of a trial with the channels of goals: from disturbances to what goals limit."""

from collections.abc import Sequence

import numpy as np

from flexslew_control.analysis.lti import Lti
from flexslew_control.analysis.signals import APPLIED
from flexslew_lab.tuning.body_axis_signals import BodyAxisSignals
from flexslew_lab.tuning.closed_loop import PerformancePlant
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput

EFFORT, COMMAND, ERROR, MEASURED = "effort.", "command.", "error.", "measured."
TORQUE = "torque."
_REFERENCES = ("reference", "reference_rate")
_OF_LAW = {"error": "position", "error_rate": "rate"}


class PlantChannels:
    """Signals of a sampled plant as rows over (x, disturbances, noise, references, u).

    Args:
        plant: from `effort.JOINT` to the sensors, its applied efforts among its outputs.
        axes: of a law on the body axes, whose torque is allocated; None: its axes are the joints.
    """

    def __init__(self, plant: Lti, axes: BodyAxisSignals | None = None) -> None:
        self.plant, self.axes = plant, axes
        self.joints = tuple(name.removeprefix(EFFORT) for name in plant.inputs)
        self.sensors = tuple(name for name in plant.outputs if not name.startswith(APPLIED))
        self.sources = (
            *(f"disturbance.{joint}" for joint in self.joints),
            *(f"noise.{sensor}" for sensor in self.sensors),
            *(f"reference.{joint}" for joint in self.joints),
        )
        self.targets = (
            *plant.inputs,
            *(f"{ERROR}{joint}" for joint in self.joints),
            *plant.outputs,
        )

    def between(
        self, sources: Sequence[str], targets: Sequence[str], signals: Sequence[str],
        efforts: Sequence[str],
    ) -> PerformancePlant:  # fmt: skip
        """Return the plant from (sources, efforts) to (targets, signals).

        Args:
            sources: names of w.
            targets: names of z.
            signals: what the law reads, y.
            efforts: what it commands, u.

        Raises:
            BadInput: if a name is unknown.
        """
        rows = [self._target(name) for name in targets] + [self._signal(name) for name in signals]
        n, w = len(self.plant.a), [self._source(name) for name in sources]
        m, k = len(self.joints), self._reader_states
        whole = np.array(rows).reshape(len(rows), self._width)
        into = np.zeros((n + k, self._width))
        into[:n, :n] = self.plant.a
        into[:n, n + k : n + k + m] = into[:n, -m:] = self.plant.b
        if self.axes is not None and k:
            reader = self.axes.reader
            into[n:, :] = reader.b @ np.array([self._part(name) for name in reader.inputs])
            into[n:, n : n + k] = reader.a
        columns = np.zeros((self._width, len(w) + len(efforts)))
        columns[[n + k + source for source in w], range(len(w))] = 1.0
        for column, name in enumerate(efforts, len(w)):
            columns[-m:, column] = self._effort(name)
        found = PerformancePlant(
            into[:, : n + k], into @ columns, whole[:, : n + k], whole @ columns, len(efforts),
            len(signals), self.plant.period,
        )  # fmt: skip
        # the memory of a filter has the poles of the memory of applied efforts
        return found.trimmed() if k else found

    def commanded(self, efforts: Sequence[str]) -> tuple[str, ...]:
        """Return the efforts of joints that a law's outputs reach.

        Raises:
            BadInput: if a name is unknown.
        """
        spread = np.array([self._effort(name) for name in efforts])
        return tuple(n for n, reached in zip(self.plant.inputs, spread.T, strict=True)
                     if reached.any())  # fmt: skip

    def sensors_of(self, signals: Sequence[str]) -> tuple[str, ...]:
        """Return the sensors that a law reads by its signals."""
        found: list[str] = []
        for part in (part.strip() for text in signals for part in text.split("+")):
            kind, _, of = part.partition(".")
            if self.axes is not None and of in self.axes.names:
                reader = self.axes.reader
                found += [
                    name for name, b, d in zip(reader.inputs, reader.b.T, reader.d.T, strict=True)
                    if b.any() or d.any()
                ]  # fmt: skip
            found.append(f"{_OF_LAW.get(kind, kind)}.{of}")
        return tuple(name for name in dict.fromkeys(found) if name in self.sensors)

    @property
    def _reader_states(self) -> int:
        return 0 if self.axes is None else len(self.axes.reader.a)

    @property
    def _before_sources(self) -> int:
        """Number of states, those of the plant and then of the reader."""
        return len(self.plant.a) + self._reader_states

    @property
    def _width(self) -> int:
        return self._before_sources + len(self.sources) + len(self.joints)

    def _source(self, name: str) -> int:
        if name not in self.sources:
            raise BadInput(f"one of {_short(self.sources)}", key="source", value=name)
        return self.sources.index(name)

    def _effort(self, name: str) -> Vector:
        """Return the efforts of all joints of a unit of an output, shape (joints,)."""
        known, spread = self.plant.inputs, np.eye(len(self.joints))
        if self.axes is not None:
            known, spread = tuple(TORQUE + axis for axis in self.axes.names), self.axes.spread
        if name not in known:
            raise BadInput(f"one of {_short(known)}", key="outputs", value=name)
        return np.asarray(spread[:, known.index(name)])

    def _unit(self, place: int) -> Vector:
        row = np.zeros(self._width)
        row[place] = 1.0
        return row

    def _target(self, name: str) -> Vector:
        """Return what a goal limits; sensors are without their noise."""
        n = self._before_sources
        offset = n + len(self.sources)
        if name in self.plant.inputs:
            return self._unit(offset + self.plant.inputs.index(name))
        if name.startswith(COMMAND):  # what goes to the motors: the demand and the disturbance
            at = self.joints.index(name.removeprefix(COMMAND))
            return self._unit(offset + at) + self._unit(n + at)
        if name.startswith(MEASURED):
            return self._measured(name.removeprefix(MEASURED))
        if name.removeprefix(ERROR) in self.joints and name.startswith(ERROR):
            joint = name.removeprefix(ERROR)
            reference = self._unit(n + self.sources.index(f"reference.{joint}"))
            return reference - self._sensor(f"position.{joint}")
        if name not in self.plant.outputs:
            raise BadInput(f"one of {_short(self.targets)}", key="to", value=name)
        return self._sensor(name)

    def _sensor(self, name: str) -> Vector:
        k, n, row = self.plant.outputs.index(name), self._before_sources, np.zeros(self._width)
        row[: len(self.plant.a)] = self.plant.c[k]
        m = len(self.joints)
        row[n : n + m] = row[n + len(self.sources) :] = self.plant.d[k]
        return row

    def _measured(self, name: str) -> Vector:
        noise = self._unit(self._before_sources + self.sources.index(f"noise.{name}"))
        return self._sensor(name) + noise

    def _signal(self, text: str) -> Vector:
        """Return what a law reads: a signal, or a sum of several."""
        parts = [part.strip() for part in text.split("+")]
        return np.asarray(np.sum([self._part(part) for part in parts], axis=0))

    def _part(self, name: str) -> Vector:
        kind, _, of = name.partition(".")
        if self.axes is not None and of in self.axes.names:
            return self._of_axis(self.axes, kind, of)
        if kind in _REFERENCES and of in self.joints:
            if kind == "reference_rate":  # goals have constant references
                return np.zeros(self._width)
            return self._unit(self._before_sources + self.sources.index(name))
        if kind in _OF_LAW and of in self.joints:
            reference = "reference" if kind == "error" else "reference_rate"
            return self._part(f"{reference}.{of}") - self._measured(f"{_OF_LAW[kind]}.{of}")
        if kind == APPLIED and name in self.plant.outputs:
            return self._sensor(name)
        if name not in self.sensors:
            known = (*(f"{k}.{j}" for k in _OF_LAW for j in self.joints), *self.sensors)
            raise BadInput(f"one of {_short(known)}", key="inputs", value=name)
        return self._measured(name)

    def _of_axis(self, axes: BodyAxisSignals, kind: str, axis: str) -> Vector:
        """Return a signal of a body axis.

        Raises:
            BadInput: if there is none of this kind.
        """
        reader, n = axes.reader, len(self.plant.a)
        if kind in _OF_LAW:
            k = reader.outputs.index(f"{kind}.{axis}")
            given = np.array([self._part(name) for name in reader.inputs])
            row = np.asarray(reader.d[k] @ given)
            row[n : n + len(reader.a)] = reader.c[k]
            return row
        if kind != APPLIED:
            known = [f"{one}.{axis}" for one in (*_OF_LAW, APPLIED)]
            raise BadInput(f"one of {_short(known)}", key="inputs", value=f"{kind}.{axis}")
        applied = np.array([self._part(f"{kind}.{joint}") for joint in self.joints])
        return np.asarray(axes.torque[axes.names.index(axis)] @ applied)


def _short(names: Sequence[str]) -> str:
    shown = ", ".join(names[:8])
    return f"{shown}, ... ({len(names)})" if len(names) > 8 else shown


def with_weights(plant: PerformancePlant, weight: tuple[Matrix, Matrix, Matrix, Matrix]) -> (
    PerformancePlant
):  # fmt: skip
    """Return a plant with the same filter of one input on each of its performance outputs.

    Args:
        plant: its outputs z, then y.
        weight: A, B, C, D of the filter, sampled as the plant is.
    """
    count = len(plant.d) - plant.measurements
    eye = np.eye(count)
    a, b, c, d = (np.kron(eye, part) for part in weight)
    z, y = plant.c[:count], plant.c[count:]
    dz, dy = plant.d[:count], plant.d[count:]
    n, k = len(plant.a), len(a)
    return PerformancePlant(
        np.block([[plant.a, np.zeros((n, k))], [b @ z, a]]),
        np.vstack((plant.b, b @ dz)),
        np.block([[d @ z, c], [y, np.zeros((len(y), k))]]),
        np.vstack((d @ dz, dy)),
        plant.controls,
        plant.measurements,
        plant.period,
    )
