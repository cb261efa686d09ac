"""What the sensors on the appendages and the platform read."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.appendages import Appendages
from flexslew_plant.testbeds.instruments import Instrument
from flexslew_plant.testbeds.instruments.instrument import channels as places
from flexslew_plant.testbeds.spacecraft.assembly.bodies import unit_direction
from flexslew_plant.testbeds.spacecraft.assembly.craft import Appendage, Spacecraft
from flexslew_plant.testbeds.spacecraft.assembly.drives import point_on
from flexslew_plant.testbeds.spacecraft.assembly.packing import packed
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.equations.readings import hinge_state
from flexslew_plant.testbeds.spacecraft.instruments import body_of, instrument_of
from flexslew_plant.testbeds.spacecraft.settings import AnySensor, SensorPlace, Triple
from flexslew_plant.testbeds.spacecraft.shapes.shape import FlexibleShape
from flexslew_plant.testbeds.spacecraft.units import Units

_SMALL = 0.1  # deflection that counts as small, of the length [-]
_UNITS = {  # of a reading, by the kind of its sensor
    "displacement": "m", "rate": "m/s", "strain": "", "accelerometer": "m/s^2", "gyro": "rad/s",
    "star_tracker": "", "sun_sensor": "", "resolver": "rad", "tachometer": "rad/s",
}  # fmt: skip


@dataclass(frozen=True)
class Accelerometer:
    """One at a point of the platform or of an appendage, in the axes of the one it sits on.

    An appendage that is fixed counts as a part of the platform, with numbers in body axes.

    Args:
        direction: unit vector, shape (3,).
        place: of the point, undeformed, shape (3,) [m].
        displacement: what all modes do there, shape (3, modes) [-].
        hinge: of the appendage in body axes, shape (3,) [m]; unused on the platform.
        index: of an appendage that turns in its hinge.
    """

    direction: Vector
    place: Vector
    displacement: Matrix
    hinge: Vector
    index: int | None = None

    def read(self, spacecraft: Spacecraft, p: Vector, x: Vector, slope: Vector, t: float) -> float:
        """Return a + w' x rho + w x (w x rho) + 2 w x Phi q' + Phi q'' along it [m/s^2].

        a is the acceleration of the body origin, or of the hinge of an appendage that turns, and w
        the angular velocity of the axes that it sits in.

        Args:
            spacecraft: the spacecraft in that state.
            p: packed spacecraft.
            x: state [q, v].
            slope: its derivative.
            t: time [s].
        """
        count, modes = spacecraft.sizes[0], spacecraft.modes
        v, rates = x[count:], slope[count:]
        velocity, spin = _body(spacecraft, v)
        push, angular_acceleration = _body(spacecraft, rates)
        push = push + np.cross(spin, velocity)
        if self.index is not None:
            push = push + np.cross(angular_acceleration, self.hinge)
            push = push + np.cross(spin, np.cross(spin, self.hinge))
            e, relative, relative_rate = map(np.array, hinge_state(p, self.index, x, slope, t))
            axes = e.reshape(3, 3)
            push, spin, angular_acceleration = axes @ push, axes @ spin, axes @ angular_acceleration
            angular_acceleration = angular_acceleration + relative_rate + np.cross(spin, relative)
            spin = spin + relative
        rho = self.place + self.displacement @ x[count - modes : count]
        modal_velocity = self.displacement @ v[v.size - modes :]
        total = push + np.cross(angular_acceleration, rho)
        total = total + np.cross(spin, np.cross(spin, rho) + 2.0 * modal_velocity)
        total = total + self.displacement @ rates[v.size - modes :]
        return float(self.direction @ total)


def _body(spacecraft: Spacecraft, v: Vector) -> tuple[Vector, Vector]:
    """Return the platform's part of v as a linear and an angular one in body axes."""
    if spacecraft.motion == at.FREE:
        return v[:3], v[3:6]
    rate = v[0] if spacecraft.motion == at.PIVOT else 0.0
    return rate * np.cross(
        spacecraft.pivot_place, spacecraft.pivot_axis
    ), rate * spacecraft.pivot_axis


def channels(
    spacecraft: Spacecraft,
    sensors: dict[str, AnySensor],
    units: Units,
    sun: Triple | None = None,
) -> Appendages:
    """Return three displacements of each tip along body axes, their rates, then the sensors.

    Args:
        spacecraft: the spacecraft.
        sensors: sensors by name.
        units: units of their section.
        sun: direction to the Sun if the section gives it, else None.

    Raises:
        BadInput: a sensor sits where it cannot, by its key.
    """
    names, in_truth = list[str](), list[bool]()
    none = np.zeros(spacecraft.modes)
    tip, rate, curvature, small, read = [], [], [], [], []
    for k, a in enumerate(spacecraft.appendages):
        if a.shape is None:
            continue
        rows = _of_all(spacecraft, k, a.axes.T @ a.shape.tip.displacement)
        curvature_rows = np.zeros_like(rows)
        if a.shape.along is not None:
            curvature_rows = _of_all(spacecraft, k, a.axes.T @ a.shape.along.point(0.0).curvature)
        names += [f"{a.name}_{axis}" for axis in "xyz"]
        names += [f"{a.name}_rate_{axis}" for axis in "xyz"]
        in_truth += [True] * 3 + [False] * 3
        zeros = np.zeros_like(rows)
        tip += [*rows, *zeros]
        rate += [*zeros, *rows]
        curvature += [*curvature_rows, *zeros]
        small += [_SMALL * _size(a.shape)] * 3 + [np.inf] * 3
        read += ["m"] * 3 + ["m/s"] * 3
    acceleration_sensors: dict[int, Accelerometer] = {}
    instruments: list[Instrument] = []
    for name, sensor in sensors.items():
        key = f"testbed.sensors.{name}"
        if not isinstance(sensor, SensorPlace):
            instruments.append(instrument_of(spacecraft, name, sensor, len(names), sun))
            channel_names = [f"{name}_{axis}" for axis in instruments[-1].axes]
        else:
            channel_names = [name]
        if set(channel_names) & set(names):
            raise BadInput(f"{key}: this name is taken; give another one")
        row, is_rate = none, False
        if isinstance(sensor, SensorPlace):
            is_rate = sensor.kind == "rate"
            if sensor.kind == "accelerometer":
                acceleration_sensors[len(names)] = _accelerometer(spacecraft, sensor, units, key)
            else:
                row = _row(spacecraft, sensor, units, key)
        names += channel_names
        from_state = isinstance(sensor, SensorPlace) and sensor.kind in ("displacement", "strain")
        in_truth += [from_state] * len(channel_names)
        tip += [none if is_rate else row] * len(channel_names)
        rate += [row if is_rate else none] * len(channel_names)
        curvature += [none] * len(channel_names)
        small += [np.inf] * len(channel_names)
        read += [_UNITS[sensor.kind]] * len(channel_names)
    empty = np.zeros((0, spacecraft.modes))
    return Appendages(
        tuple(names),
        np.vstack([empty, *tip]),
        np.vstack([empty, *curvature]),
        np.vstack([empty, *rate]),
        _exact_reader(spacecraft, acceleration_sensors, tuple(instruments), len(names))
        if acceleration_sensors or instruments
        else None,
        _errors(sensors, names) if sensors else None,
        np.array(small),
        tuple(instruments),
        partial(body_of, spacecraft) if instruments else None,
        tuple(read),
        tuple(in_truth),
    )


def _size(shape: FlexibleShape) -> float:
    """Return how long an appendage is; infinite where its data do not determine it [m]."""
    length = float(np.linalg.norm(shape.line - shape.line[0], axis=1).max())
    return length or np.inf


def _of_all(spacecraft: Spacecraft, k: int, rows: Matrix) -> Matrix:
    """Return maps of the modes of appendage k as maps of all modes."""
    first = spacecraft.first_mode(k)
    full = np.zeros((len(rows), spacecraft.modes))
    full[:, first : first + rows.shape[1]] = rows
    return full


def _index(spacecraft: Spacecraft, sensor: SensorPlace, key: str) -> int:
    names = [a.name for a in spacecraft.appendages]
    if sensor.appendage not in names:
        raise BadInput(
            f"{key}.appendage: {sensor.appendage} is no appendage; allowed: {', '.join(names)}"
        )
    return names.index(sensor.appendage)


def _row(spacecraft: Spacecraft, sensor: SensorPlace, units: Units, key: str) -> Vector:
    """Return a displacement's, a rate's or a strain's map of all modes, shape (modes,)."""
    k = _index(spacecraft, sensor, key)
    a = spacecraft.appendages[k]
    if sensor.kind != "strain":
        point = point_on(a, sensor, units, key)
        along = unit_direction(sensor.direction, f"{key}.direction")
        modal_row: Vector = _of_all(spacecraft, k, along[None] @ point.displacement)[0]
        return modal_row
    if a.shape is None or a.shape.along is None:
        raise BadInput(f"{key}.appendage: {a.name} is not a beam: its strain is unknown")
    at_root = 0.0 if sensor.at is None else sensor.at * units.length
    curvature_rows = a.shape.along.point(at_root).curvature
    fibre = np.array(sensor.fibre) * units.length
    strain: Vector = _of_all(spacecraft, k, -(fibre[None] @ curvature_rows))[0]
    return strain


def _accelerometer(
    spacecraft: Spacecraft, sensor: SensorPlace, units: Units, key: str
) -> Accelerometer:
    """Return it in body axes."""
    along = unit_direction(sensor.direction, f"{key}.direction")
    place = np.array(sensor.place) * units.length
    if sensor.appendage is None:
        return Accelerometer(along, place, np.zeros((3, spacecraft.modes)), np.zeros(3))
    k = _index(spacecraft, sensor, key)
    a: Appendage = spacecraft.appendages[k]
    point = point_on(a, sensor, units, key)
    if a.hinge != at.FIXED:
        return Accelerometer(
            along, point.place, _of_all(spacecraft, k, point.displacement), a.place, k
        )
    r = a.axes.T
    modes = _of_all(spacecraft, k, r @ point.displacement)
    return Accelerometer(r @ along, a.place + r @ point.place, modes, a.place)


def _exact_reader(
    spacecraft: Spacecraft,
    acceleration_sensors: dict[int, Accelerometer],
    instruments: tuple[Instrument, ...],
    count: int,
) -> Callable[[Vector, Vector, float], Vector]:
    """Return what accelerometers and instruments read without errors, among all channels."""
    p = packed(spacecraft)

    def read(x: Vector, slope: Vector, t: float) -> Vector:
        out = np.zeros(count)
        for k, accelerometer in acceleration_sensors.items():
            out[k] = accelerometer.read(spacecraft, p, x, slope, t)
        for instrument in instruments:
            out[places(instrument)] = instrument.exact(body_of(spacecraft, x))
        return out

    return read


def _errors(sensors: dict[str, AnySensor], names: list[str]) -> Matrix:
    """Return noise, bias and quantisation of every reading, shape (3, count)."""
    errors = np.zeros((3, len(names)))
    for name, sensor in sensors.items():
        if isinstance(sensor, SensorPlace):
            errors[:, names.index(name)] = sensor.noise, sensor.bias, sensor.quantisation
    return errors
