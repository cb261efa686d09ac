"""The closed sampled loop of a plant and a running law, opened at the cuts of a margin.

Connections are by hand as in lti, since a margin may be required with any cut open: control.connect
makes one system of each, here the two parts are evaluated once over frequency for all cuts.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from flexslew_control.analysis.lti import Lti
from flexslew_control.analysis.signals import APPLIED, POSITION
from flexslew_plant.arrays import Matrix, Vector

Complex: TypeAlias = NDArray[np.complex128]

_LEAST_RESIDUE = 1e-8  # of the largest residue: what is excited or shown less is rounding
_HIDDEN = 1e-6  # above one: a pole outside of the circle, though no effort moves it


@dataclass(frozen=True)
class ControlLoop:
    """Plant and controller side by side, all connections between them cut.

    From (v, e, r) to (u, y): v is the motors' command, u the controller's demand, y the sensors'
    output, e the controller's input, r its references. What it reads of the applied
    efforts stays connected: that is inside of the plant's drive.

    Args:
        system: state space with these inputs and outputs.
        efforts: number of efforts.
        sensors: number of sensors that the controller reads.
        parts: plant from v to (y, applied efforts), law from (e, applied efforts) to u.
        joint_names: names of the plant's joints.
        joint_positions: how states show them, whether the controller reads them or not, shape
            (joints, states).
    """

    system: Lti
    efforts: int
    sensors: int
    parts: tuple[Lti, Lti]
    joint_names: tuple[str, ...]
    joint_positions: Matrix

    @property
    def effort_names(self) -> tuple[str, ...]:
        """Of u and v."""
        return self.system.inputs[: self.efforts]

    @property
    def sensor_names(self) -> tuple[str, ...]:
        """Of y and e."""
        return self.system.inputs[self.efforts : self.efforts + self.sensors]

    def connected(self, names: Sequence[str]) -> Lti:
        """Return the system with these cuts closed: v = u, e = y."""
        s, keep = self.system, [k for k, n in enumerate(self.system.inputs) if n in set(names)]
        pick = np.zeros((len(s.inputs), len(s.outputs)))
        for k in keep:
            pick[k, k] = 1.0  # cuts stand first, in one order at both ends
        direct = np.linalg.inv(np.eye(len(s.outputs)) - s.d @ pick)
        feedback = pick @ direct
        return Lti(
            s.a + s.b @ feedback @ s.c,
            s.b @ (np.eye(len(s.inputs)) + feedback @ s.d),
            direct @ s.c,
            direct @ s.d,
            s.inputs,
            s.outputs,
            s.states,
            s.period,
        )

    @property
    def closed(self) -> Lti:
        """The system with every cut closed."""
        return self.connected(self.effort_names + self.sensor_names)

    def opened(self, names: Sequence[str]) -> Lti:
        """Return L of the loop cut at these places alone; it is closed by negative feedback."""
        others = [n for n in self.effort_names + self.sensor_names if n not in set(names)]
        s = self.connected(others)
        channels = [s.inputs.index(name) for name in names]
        return Lti(
            s.a, s.b[:, channels], -s.c[channels], -s.d[np.ix_(channels, channels)], tuple(names),
            tuple(names),
            s.states, s.period,
        )  # fmt: skip

    def response(self, w: Vector) -> Complex:
        """Return the way from (v, e) to (u, y) at frequencies [rad/s], (len(w), cuts, cuts)."""
        z, (plant, law) = np.exp(1j * w * self.system.period), self.parts
        m, k = self.efforts, self.sensors
        p, c = plant.at(z), law.at(z)
        out = np.zeros((len(z), m + k, m + k), dtype=np.complex128)
        out[:, :m, :m] = c[:, :, k:] @ p[:, k:]
        out[:, :m, m:] = c[:, :, :k]
        out[:, m:, :m] = p[:, :k]
        return out

    def loop_gain(self, names: Sequence[str], response: Complex) -> Complex:
        """Return L of the loop cut at these places alone; it is closed by negative feedback.

        Args:
            names: of efforts and sensors.
            response: see `response`, shape (frequencies, cuts, cuts).
        """
        channels = self.effort_names + self.sensor_names
        at = [channels.index(name) for name in names]
        rest = [k for k in range(len(channels)) if k not in at]

        def part(rows: list[int], columns: list[int]) -> Complex:
            return response[:, rows][:, :, columns]

        inner = np.eye(len(rest)) - part(rest, rest)
        return -(part(at, at) + part(at, rest) @ np.linalg.solve(inner, part(rest, at)))

    @property
    def poles(self) -> Complex:
        """Of the closed loop, in z."""
        return np.asarray(np.linalg.eigvals(self.closed.a), dtype=np.complex128)


def loop_of(plant: Lti, law: Lti) -> ControlLoop:
    """Return the loop of a sampled plant (applied efforts among its outputs) and a law.

    Sensors that the law does not listen to are left out.
    """
    sensors = [
        name
        for name in plant.outputs
        if not name.startswith(APPLIED)
        and (law.b[:, law.inputs.index(name)].any() or law.d[:, law.inputs.index(name)].any())
    ]
    applied = [name for name in plant.outputs if name.startswith(APPLIED)]
    references = [name for name in law.inputs if name not in plant.outputs]
    y, a = plant.rows(sensors).c, plant.rows(applied).c
    by_y, by_a, by_r = (
        (law.b[:, columns], law.d[:, columns])
        for columns in (
            [law.inputs.index(n) for n in names] for names in (sensors, applied, references)
        )
    )
    n, k, m = len(plant.a), len(law.a), len(plant.inputs)
    zero = np.zeros
    system = Lti(
        np.block([[plant.a, zero((n, k))], [by_a[0] @ a, law.a]]),
        np.block([[plant.b, zero((n, len(sensors) + len(references)))],
                  [zero((k, m)), by_y[0], by_r[0]]]),
        np.block([[by_a[1] @ a, law.c], [y, zero((len(sensors), k))]]),
        np.block([[zero((m, m)), by_y[1], by_r[1]],
                  [zero((len(sensors), m + len(sensors) + len(references)))]]),
        (*plant.inputs, *sensors, *references),
        (*plant.inputs, *sensors),
        (*plant.states, *law.states),
        plant.period,
    )  # fmt: skip
    plant_part = plant.rows((*sensors, *applied))
    columns = [law.inputs.index(name) for name in (*sensors, *applied)]
    law_part = replace(law, b=law.b[:, columns], d=law.d[:, columns], inputs=(*sensors, *applied))
    joints = [name for name in plant.outputs if name.startswith(POSITION)]
    observed = np.hstack((plant.rows(joints).c, zero((len(joints), k))))
    names = tuple(name.removeprefix(POSITION) for name in joints)
    return ControlLoop(system, m, len(sensors), (plant_part, law_part), names, observed)


def visible_poles(loop: ControlLoop, share: float = _LEAST_RESIDUE) -> tuple[Complex, Vector]:
    """Return the poles of the closed loop that efforts move and sensors see, and how strongly.

    Returns:
        poles in z, shape (k,), and the size of their residues between all efforts and sensors,
        of the largest, shape (k,).
    """
    parts = _residues(loop)
    residues = parts.of(parts.by_efforts, parts.in_sensors)
    kept = residues > share
    return parts.z[kept], residues[kept]


def unstable_poles(loop: ControlLoop, close: float = 1e-9) -> Complex:
    """Return the poles outside of the unit circle that anything in the loop excites and shows.

    In addition to the visible ones: an estimator's error, if the estimator reads the efforts, is
    moved by no effort but by errors of the sensors, and the controller's demand shows it. A pole
    hidden in this way is known less exactly, and counts only beyond _HIDDEN.

    Args:
        loop: cut everywhere.
        close: above one, rounding of a visible motion that nothing holds.
    """
    parts = _residues(loop)
    excited, observed = (parts.by_efforts, parts.by_sensors), (parts.in_efforts, parts.in_sensors)
    active = np.array([parts.of(by, seen) for by in excited for seen in observed]) > _LEAST_RESIDUE
    visible = parts.of(parts.by_efforts, parts.in_sensors) > _LEAST_RESIDUE
    size = abs(parts.z)
    found: Complex = parts.z[
        (visible & (size > 1.0 + close)) | (active.any(axis=0) & (size > 1.0 + _HIDDEN))
    ]
    return found


class _Residues(NamedTuple):
    """Poles of a closed loop, and how much of each is between inputs and outputs, shape (k,)."""

    z: Complex
    by_efforts: Vector  # how strongly v excites it
    by_sensors: Vector  # e
    in_efforts: Vector  # how strongly u shows it
    in_sensors: Vector  # y

    def of(self, excited: Vector, observed: Vector) -> Vector:
        """Return the residues between the two, of the largest."""
        size = excited * observed
        return np.asarray(size / size.max(initial=1e-300), dtype=np.float64)


def _residues(loop: ControlLoop) -> _Residues:
    closed, m, channels = loop.closed, loop.efforts, loop.efforts + loop.sensors
    z, right = np.linalg.eig(closed.a)
    left = np.linalg.pinv(right)
    return _Residues(
        np.asarray(z, dtype=np.complex128),
        np.linalg.norm(left @ closed.b[:, :m], axis=1),
        np.linalg.norm(left @ closed.b[:, m:channels], axis=1),
        np.linalg.norm(closed.c[:m] @ right, axis=0),
        np.linalg.norm(closed.c[m:] @ right, axis=0),
    )
