"""How a torque in three axes is shared out among drives: the `allocation` section of a law."""

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Literal, TypeAlias

import numpy as np
from pydantic import Field

from flexslew_control.allocation.gyro_set import GyroSet
from flexslew_control.allocation.sharing import NONE, ActuatorIndices, AllocationNumbers, share
from flexslew_control.allocation.thruster_set import ThrusterSet
from flexslew_control.allocation.wheel_set import WheelSet
from flexslew_control.law import PlantDescription, per_joint
from flexslew_plant.arrays import EMPTY, Indices, Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import Measurement
from flexslew_plant.settings import NonNegative, section
from flexslew_plant.testbeds.contract import DriveMap, TurnedByDrives
from flexslew_plant.testbeds.instruments import Resolver, Tachometer
from flexslew_plant.testbeds.instruments.instrument import channels

_STORED = 0.01  # of a bias: what of it may store momentum that thrusters take away


@section
class ThrusterAllocation:
    """The torque as pushes of thrusters that burn the least; their valves make pulses of them."""

    kind: Literal["thrusters"]
    drives: tuple[str, ...] | None = None  # by name; null: all thrusters


@section
class WheelAllocation:
    """The torque by the pseudo-inverse of the wheels' axes, null motion, and unloading."""

    kind: Literal["wheels"]
    drives: tuple[str, ...] | None = None  # by name; null: all wheels
    # rate at which null motion brings the wheels to their bias; needs a tachometer [1/s]
    null_motion: NonNegative = 0.0
    # of each wheel, or one for all; what of it stores momentum is left out [rad/s]
    bias_speed: tuple[float, ...] = (0.0,)
    # rate at which thrusters take the stored momentum; needs a tachometer; 0: they do not [1/s]
    unloading: NonNegative = 0.0
    thrusters: tuple[str, ...] | None = None  # that unload, by name; null: all


@section
class GyroAllocation:
    """The torque by rates of the gimbals of control moment gyros, past their singularities.

    The gimbals' angles are read by a resolver. See gyro_set.GyroSet.
    """

    kind: Literal["control_moment_gyros"]
    drives: tuple[str, ...] | None = None  # by name; null: all control moment gyros
    # regularisation at a singularity; 0: the plain pseudo-inverse, which can lock there [-]
    robustness: NonNegative = 0.1
    dither: Annotated[float, Field(ge=0.0, lt=0.5)] = 0.2  # by which locked gimbals leave it [-]
    dither_frequency: NonNegative = 3.0  # of the dither [rad/s]
    # rate at which null motion brings the gimbals to the angles preferred [1/s]
    null_motion: NonNegative = 0.0
    preferred_angle: tuple[float, ...] = (0.0,)  # of each gimbal, or one for all [rad]


AnyAllocation: TypeAlias = ThrusterAllocation | WheelAllocation | GyroAllocation
Allocation: TypeAlias = Annotated[AnyAllocation, Field(discriminator="kind")]


@dataclass(frozen=True)
class Allocator:
    """Shares a torque out among the joints' drives.

    Args:
        joints: number of joints.
        torque: torque about the centre of mass by a unit effort of each joint, shape (3, joints).
        wheels: joint indices and set; None: no wheel takes part.
        thrusters: joint indices and set; None: none takes part.
        unloading: rate at which thrusters take what the wheels store [1/s].
        speeds: channels of the tachometer; None: the wheels' speeds are not measured.
        gyros: joint indices, set and channels of the resolver; None: none.
    """

    joints: int
    torque: Matrix
    wheels: tuple[Indices, WheelSet] | None
    thrusters: tuple[Indices, ThrusterSet] | None
    unloading: float = 0.0
    speeds: Indices | None = None
    gyros: tuple[Indices, GyroSet, Indices] | None = None

    @property
    def limit(self) -> Vector:
        """Largest torque about each body axis alone, of those that share it, shape (3,) [N m]."""
        return np.array([min(self._most(axis), self._most(-axis)) for axis in np.eye(3)])

    def _most(self, axis: Vector) -> float:
        return float(axis @ self.torque @ self.shares(1e9 * axis))

    def efforts(self, torque: Vector, measurement: Measurement) -> Vector:
        """Return the efforts of all joints that give a torque, shape (joints,) [N m or N].

        Args:
            torque: about the centre of mass, in body axes, shape (3,) [N m].
            measurement: of this tick.
        """
        return self._shared(torque, measurement.tip_deflection, measurement.time)

    def shares(self, torque: Vector) -> Vector:
        """Return the efforts that give a torque and nothing else: no null motion, no unloading.

        Gimbals stand at zero. Beyond the limits they give less of it, shape (joints,) [N m or N].
        """
        return self._shared(torque, EMPTY, 0.0)

    def _shared(self, torque: Vector, measurements: Vector, time: float) -> Vector:
        out = np.empty(self.joints)
        share(self.numbers, 0, torque, measurements, time, out)
        return out

    @cached_property
    def numbers(self) -> AllocationNumbers:
        """The same for machine code, in a batch of one."""
        drives, torque = ActuatorIndices(), np.ascontiguousarray(self.torque)[None]
        found = AllocationNumbers(drives, torque, np.array([self.unloading]))
        if self.wheels is not None:
            speed_channels = NONE if self.speeds is None else self.speeds
            drives = drives._replace(wheels=self.wheels[0], speeds=speed_channels)
            found = found._replace(wheels=self.wheels[1].numbers)
        if self.thrusters is not None:
            drives = drives._replace(thrusters=self.thrusters[0])
            found = found._replace(thrusters=self.thrusters[1].numbers)
        if self.gyros is not None:
            drives = drives._replace(gyros=self.gyros[0], angles=self.gyros[2])
            found = found._replace(gyros=self.gyros[1].numbers)
        return found._replace(drives=drives)

    @cached_property
    def spread(self) -> Matrix:
        """Return efforts per torque as small motions see them, shape (joints, 3).

        Wheels give it, and gyros with gimbals at zero; of thrusters it is the pseudo-inverse, which
        has the same torque.
        """
        out = np.zeros((self.joints, 3))
        where = (self.wheels or self.gyros or self.thrusters or (np.zeros(0, dtype=np.int64),))[0]
        out[where] = np.linalg.pinv(self.torque[:, where])
        return out


def allocator_of(settings: AnyAllocation, plant: PlantDescription) -> Allocator:
    """Return the allocator of a torque to the drives of a testbed.

    Raises:
        BadInput: if it does not turn in three axes, a name is no such drive, the drives cannot give
            every torque, or the required speeds are not measured.
    """
    testbed, names = plant.testbed, plant.joint_names
    if testbed.model().attitude is None or not isinstance(testbed, TurnedByDrives):
        words = "the joints of this testbed do not turn it in three axes"
        raise BadInput(words, key="allocation")
    found, limit = testbed.drive_map(), plant.effort_limit

    def thrusters(key: str, given: tuple[str, ...] | None) -> tuple[Indices, ThrusterSet]:
        where = _actuator_indices(f"allocation.{key}", given, found.one_way, names, "thrusters")
        called = tuple(names[k] for k in where)
        return where, ThrusterSet.of(found.torque[:, where], limit[where], called)

    if isinstance(settings, ThrusterAllocation):
        return Allocator(len(names), found.torque, None, thrusters("drives", settings.drives))
    if isinstance(settings, GyroAllocation):
        return Allocator(len(names), found.torque, None, None, gyros=_gyros(settings, plant, found))
    where = _actuator_indices("allocation.drives", settings.drives, found.wheels, names, "wheels")
    called = tuple(names[k] for k in where)
    inertia = found.inertia[[found.wheels.index(k) for k in where]]
    bias = inertia * per_joint("allocation.bias_speed", settings.bias_speed, called)
    wheels = WheelSet(found.torque[:, where], limit[where], inertia, settings.null_motion, bias)
    speeds = _read_by(Tachometer, plant, called)
    for key in ("null_motion", "unloading"):
        if getattr(settings, key) and speeds is None:
            words = "needs the wheels' speeds: give the testbed a sensor of kind tachometer"
            raise BadInput(words, key=f"allocation.{key}", value=getattr(settings, key))
    _require_bias(settings, wheels)
    thruster_set = thrusters("thrusters", settings.thrusters) if settings.unloading else None
    return Allocator(
        len(names), found.torque, (where, wheels), thruster_set, settings.unloading, speeds
    )


def _require_bias(settings: WheelAllocation, wheels: WheelSet) -> None:
    """Refuse speeds of bias to which the wheels do not go.

    Raises:
        BadInput: there is no null motion, or thrusters take away the momentum that they store.
    """
    if not wheels.bias.any():
        return
    key, given = "allocation.bias_speed", [*settings.bias_speed]
    if not settings.null_motion:
        raise BadInput("has no effect without null_motion; give a rate, or no bias", "", key, given)
    stored = wheels.torque @ wheels.bias
    kept = wheels.bias - np.linalg.pinv(wheels.torque) @ stored
    left_out = np.linalg.norm(wheels.bias - kept) / np.linalg.norm(wheels.bias)
    if settings.unloading and left_out > _STORED:
        speeds = ", ".join(f"{speed:.4g}" for speed in kept / wheels.inertia)
        momentum = ", ".join(f"{part:.4g}" for part in stored)
        words = (
            f"stores a momentum of ({momentum}) N m s, which unloading takes away; the nearest "
            f"bias that stores none is [{speeds}] rad/s"
        )
        raise BadInput(words, "", key, given)


def _gyros(
    settings: GyroAllocation, plant: PlantDescription, found: DriveMap
) -> tuple[Indices, GyroSet, Indices]:
    """Return the gyros that share a torque, and where their angles are read.

    Raises:
        BadInput: see allocator_of.
    """
    names, what = plant.joint_names, "control moment gyros"
    where = _actuator_indices("allocation.drives", settings.drives, found.gyros, names, what)
    indices = [found.gyros.index(k) for k in where]
    called = tuple(names[k] for k in where)
    angles = _read_by(Resolver, plant, called)
    if angles is None:
        words = "needs the gimbals' angles: give the testbed a sensor of kind resolver"
        raise BadInput(words, key="allocation.kind", value=settings.kind)
    gyros = GyroSet(
        found.gimbals[indices],
        plant.effort_limit[where],
        found.momentum[indices],
        settings.robustness,
        settings.dither,
        settings.dither_frequency,
        settings.null_motion,
        per_joint("allocation.preferred_angle", settings.preferred_angle, called),
    )
    return where, gyros, angles


def _actuator_indices(
    key: str,
    given: tuple[str, ...] | None,
    known: tuple[int, ...],
    names: tuple[str, ...],
    what: str,
) -> Indices:
    """Return which joints are meant."""
    allowed = [names[k] for k in known]
    if not allowed:
        raise BadInput(f"the testbed has no {what}", key=key)
    for name in given or ():
        if name not in allowed:
            raise BadInput(f"names of {what}: {', '.join(allowed)}", key=key, value=name)
    return np.array([k for k in known if given is None or names[k] in given], dtype=np.int64)


def _read_by(
    kind: type[Tachometer | Resolver], plant: PlantDescription, drives: tuple[str, ...]
) -> Indices | None:
    """Return where an instrument of this kind reads these drives; None: there is none."""
    for instrument in plant.testbed.model().appendages.instruments:
        if isinstance(instrument, kind):
            first = channels(instrument).start
            return np.array(
                [first + instrument.axes.index(name) for name in drives], dtype=np.int64
            )
    return None
