"""The plant of a trial with the channels of goals: from disturbances to what goals limit."""

from collections.abc import Sequence

import numpy as np

from flexslew_control.analysis.lti import Lti
from flexslew_control.analysis.signals import APPLIED
from flexslew_lab.tuning.closed_loop import PerformancePlant
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput

EFFORT, COMMAND, ERROR, MEASURED = "effort.", "command.", "error.", "measured."
_REFERENCES = ("reference", "reference_rate")
_OF_LAW = {"error": "position", "error_rate": "rate"}


class PlantChannels:
    """Signals of a sampled plant as rows over (x, disturbances, noise, references, u).

    Args:
        plant: from `effort.JOINT` to the sensors, its applied efforts among its outputs.
    """

    def __init__(self, plant: Lti) -> None:
        self.plant = plant
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
        u = [n + len(self.sources) + self._effort(name) for name in efforts]
        columns = [n + k for k in w] + u
        whole = np.array(rows).reshape(len(rows), self._width)
        into = np.zeros((n, self._width))
        m = len(self.joints)
        into[:, n : n + m] = into[:, n + len(self.sources) :] = self.plant.b
        return PerformancePlant(
            self.plant.a, into[:, columns], whole[:, :n], whole[:, columns], len(u),
            len(signals), self.plant.period,
        )  # fmt: skip

    @property
    def _width(self) -> int:
        return len(self.plant.a) + len(self.sources) + len(self.joints)

    def _source(self, name: str) -> int:
        if name not in self.sources:
            raise BadInput(f"one of {_short(self.sources)}", key="source", value=name)
        return self.sources.index(name)

    def _effort(self, name: str) -> int:
        if name not in self.plant.inputs:
            raise BadInput(f"one of {_short(self.plant.inputs)}", key="outputs", value=name)
        return self.plant.inputs.index(name)

    def _unit(self, place: int) -> Vector:
        row = np.zeros(self._width)
        row[place] = 1.0
        return row

    def _target(self, name: str) -> Vector:
        """Return what a goal limits; sensors are without their noise."""
        n, offset = len(self.plant.a), len(self.plant.a) + len(self.sources)
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
        k, n, row = self.plant.outputs.index(name), len(self.plant.a), np.zeros(self._width)
        row[:n] = self.plant.c[k]
        m = len(self.joints)
        row[n : n + m] = row[n + len(self.sources) :] = self.plant.d[k]
        return row

    def _measured(self, name: str) -> Vector:
        noise = self._unit(len(self.plant.a) + self.sources.index(f"noise.{name}"))
        return self._sensor(name) + noise

    def _signal(self, text: str) -> Vector:
        """Return what a law reads: a signal, or a sum of several."""
        parts = [part.strip() for part in text.split("+")]
        return np.asarray(np.sum([self._part(part) for part in parts], axis=0))

    def _part(self, name: str) -> Vector:
        kind, _, of = name.partition(".")
        if kind in _REFERENCES and of in self.joints:
            if kind == "reference_rate":  # goals have constant references
                return np.zeros(self._width)
            return self._unit(len(self.plant.a) + self.sources.index(name))
        if kind in _OF_LAW and of in self.joints:
            reference = "reference" if kind == "error" else "reference_rate"
            return self._part(f"{reference}.{of}") - self._measured(f"{_OF_LAW[kind]}.{of}")
        if kind == APPLIED and name in self.plant.outputs:
            return self._sensor(name)
        if name not in self.sensors:
            known = (*(f"{k}.{j}" for k in _OF_LAW for j in self.joints), *self.sensors)
            raise BadInput(f"one of {_short(known)}", key="inputs", value=name)
        return self._measured(name)


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
