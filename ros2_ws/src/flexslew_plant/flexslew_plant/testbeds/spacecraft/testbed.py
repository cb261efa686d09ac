"""The `testbed` section of kind spacecraft, with the interface of the bench, laws and planners.

Joints of the bench are its actuators: the reading of an effort is the place and the rate that
the effort works on (readings.read), so any collocated law flies it. State: see layout.
"""

import os
from collections.abc import Callable, Mapping
from dataclasses import field, replace
from functools import lru_cache
from typing import Any, ClassVar, Literal

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.keys.refused_keys import SectionError
from flexslew_plant.settings import NonNegative, Positive, section
from flexslew_plant.testbeds.appendages import Appendages
from flexslew_plant.testbeds.contract import (
    Clamped,
    DriveMap,
    Floating,
    HingeTurn,
    LineOfSight,
    Motions,
    RigidTurn,
    Sky,
    Spins,
    UnitSizes,
)
from flexslew_plant.testbeds.entry import TestbedEntry
from flexslew_plant.testbeds.initial.initial_motion import InitialMotion
from flexslew_plant.testbeds.instruments import ResolverSettings
from flexslew_plant.testbeds.kernels import Kernels
from flexslew_plant.testbeds.model import Model
from flexslew_plant.testbeds.orientation.attitude import attitude_joints
from flexslew_plant.testbeds.scene import Scene
from flexslew_plant.testbeds.spacecraft.assembly.bodies import rotation_matrix, unit_direction
from flexslew_plant.testbeds.spacecraft.assembly.craft import Spacecraft, mass_warning
from flexslew_plant.testbeds.spacecraft.assembly.flexible import model_warnings
from flexslew_plant.testbeds.spacecraft.assembly.motors import motors_of, reaction_wheels_of
from flexslew_plant.testbeds.spacecraft.assembly.packing import packed, scale_stiffness, shift_time
from flexslew_plant.testbeds.spacecraft.assembly.spacecraft import build_spacecraft
from flexslew_plant.testbeds.spacecraft.channels import channels
from flexslew_plant.testbeds.spacecraft.clamped import clamped
from flexslew_plant.testbeds.spacecraft.coordinates import coordinates
from flexslew_plant.testbeds.spacecraft.drawing import scene_of
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.equations.actuation import actuation
from flexslew_plant.testbeds.spacecraft.equations.hinge_motion import next_jump
from flexslew_plant.testbeds.spacecraft.equations.jacobian import residual_jacobian
from flexslew_plant.testbeds.spacecraft.equations.kinematics import kinematics, potential
from flexslew_plant.testbeds.spacecraft.equations.readings import read
from flexslew_plant.testbeds.spacecraft.equations.terms import terms
from flexslew_plant.testbeds.spacecraft.finite_elements.readers import files_of
from flexslew_plant.testbeds.spacecraft.floating import floating
from flexslew_plant.testbeds.spacecraft.imbalance import harmonics_of
from flexslew_plant.testbeds.spacecraft.lines_of_sight import lines_of_sight
from flexslew_plant.testbeds.spacecraft.motions import motions, spins
from flexslew_plant.testbeds.spacecraft.orbit import Orbit
from flexslew_plant.testbeds.spacecraft.outside import outside_of
from flexslew_plant.testbeds.spacecraft.placing import position_unit, rest_position, rotation_axes
from flexslew_plant.testbeds.spacecraft.retargeting import (
    new_target_keys,
    prescribed_rotations,
    section_units,
)
from flexslew_plant.testbeds.spacecraft.settings import (
    IDENTITY,
    ActuatorPlace,
    AnySensor,
    AppendageSettings,
    Beam,
    Body,
    Hinge,
    Inertia,
    KeepOut,
    MomentGyroSettings,
    Platform,
    Triple,
    WheelSettings,
)
from flexslew_plant.testbeds.spacecraft.sky import sky_of
from flexslew_plant.testbeds.spacecraft.turning import (
    actuator_map,
    keep_largest_modes,
    pivot_point,
    rigid_rotation_efforts,
)
from flexslew_plant.testbeds.spacecraft.units import UNITS, UnitSystem

# a platform that is held or pivots: its q has as many entries as v
CONSTRAINED = Kernels(
    terms,
    residual_jacobian,
    potential,
    actuation,
    kinematics,
    read,
    next_jump=next_jump,
    any_size=True,
)
FLOATING = replace(CONSTRAINED, extra_positions=1)
_LIGHT = 1e-6  # inertia of a wheel in place of a gyro, of the platform's least [-]


# a torque about each body axis, of a spacecraft with no drive at all; also the mark of the default
_TORQUES = {
    name: ActuatorPlace(kind="torque", direction=axis, limit=100.0)
    for name, axis in zip(("roll", "pitch", "yaw"), IDENTITY, strict=True)
}
_STAMPS = "_file_stamps"  # where a section keeps the state of its files


@section
class SpacecraftTestbed:
    """Any platform with flexible appendages, wheels, gyros and sensors, in YAML."""

    kind: Literal["spacecraft"] = "spacecraft"
    units: UnitSystem = (
        "si"  # unit system of all but `initial`, `initial_motion` and errors of `sensors`
    )
    platform: Platform = Platform()  # the rigid platform
    appendages: dict[str, AppendageSettings] = field(default_factory=dict)  # appendages by name
    wheels: dict[str, WheelSettings] = field(default_factory=dict)  # reaction wheels by name
    # control moment gyros by name
    control_moment_gyros: dict[str, MomentGyroSettings] = field(default_factory=dict)
    # forces, torques and thrusters by name; left out: none beside wheels, control_moment_gyros or a
    # driven hinge, else a torque of 100 N m about each body axis: roll, pitch, yaw
    actuators: dict[str, ActuatorPlace] = field(default_factory=lambda: _TORQUES)
    # sensors besides pose, rates and tips, by name
    sensors: dict[str, AnySensor] = field(default_factory=dict)
    initial: dict[str, float] = field(default_factory=dict)  # by joint [rad or m]
    initial_motion: InitialMotion | None = None  # rates and deflections at the start; null: at rest
    # angle below which the line of sight counts as settled [rad]
    pointing_tolerance: Positive = 3.490658503988659e-4
    pointing_window: Positive = 10.0  # window of the mean and relative performance errors [s]
    # from when on performance errors and jitter count, if that is after the manoeuvre [s]
    pointing_from: NonNegative = 0.0
    # cones in the sky that an axis of the platform must not look into, by name
    keep_out: dict[str, KeepOut] = field(default_factory=dict)
    orbit: Orbit | None = None  # a circular orbit whose torques turn a free platform; null: none

    operating_point: ClassVar[dict[str, float]] = {}
    typical_goal: ClassVar[dict[str, float]] = {"roll": 0.5}
    simplified: ClassVar[dict[str, Any]] = {}

    def __post_init__(self) -> None:
        """Refuse what no spacecraft can be.

        Raises:
            ValueError: in words for the section's reader.
        """
        if self.actuators is _TORQUES:
            hinged = any(a.hinge.kind == "driven" for a in self.appendages.values())
            others = self.wheels or self.control_moment_gyros or hinged
            object.__setattr__(self, "actuators", {} if others else dict(_TORQUES))
        try:
            spacecraft = self.craft
            if self.orbit is not None:
                unit_direction(self.orbit.sun, "testbed.orbit.sun")
            self.channels(spacecraft)
            self.sky()
        except BadInput as error:
            raise SectionError(str(error)) from None
        if self.orbit is not None and spacecraft.motion != at.FREE:
            raise SectionError("testbed.orbit: only a free platform has one; use motion: free")
        for name, wheel in self.wheels.items():
            if harmonics_of(wheel) and spacecraft.motion != at.FREE:
                raise SectionError(
                    f"testbed.wheels.{name}: only on a free platform may it have static_imbalance, "
                    "dynamic_imbalance or harmonics; use motion: free"
                )
        if not spacecraft.drives:
            raise SectionError(
                "testbed: has no actuators; give actuators, wheels, control_moment_gyros or a "
                "driven hinge"
            )

    @property
    def modes(self) -> int:
        """How many modal coordinates."""
        return self.craft.modes

    @property
    def effort_limit(self) -> tuple[float, ...]:
        """Largest effort of each actuator [N m or N]."""
        return tuple(float(d.limit) for d in self.craft.drives)

    @property
    def craft(self) -> Spacecraft:
        """The spacecraft in SI."""
        return _spacecraft(_Same(self))

    def channels(self, spacecraft: Spacecraft) -> Appendages:
        """Return what its sensors read.

        Raises:
            BadInput: a sensor sits where it cannot, by its key.
        """
        return channels(spacecraft, self.sensors, UNITS[self.units], self._sun)

    def sky(self) -> Sky | None:
        """Return where its axes look, and the cones; see sky.HasSky."""
        return sky_of(self.craft, self.sensors, self.keep_out, self._sun)

    def attitudes(self, position: Matrix) -> Matrix:
        """Return the quaternions of positions q; see sky.HasSky."""
        return position[:, 3:7]

    @property
    def _sun(self) -> Triple | None:
        return None if self.orbit is None else self.orbit.sun

    def model(self) -> Model:
        """Return the equations of motion."""
        return _model(_Same(self))

    def scaled(self, stiffness: float = 1.0, payload: float = 1.0) -> "SpacecraftTestbed":
        """Return it with other stiffness and tip bodies, as factors [-].

        Raises:
            BadInput: if another payload is requested, and no appendage carries a tip body.
        """
        changed = {
            name: replace(a, stiffness=a.stiffness * stiffness, shape=_loaded(a.shape, payload))
            for name, a in self.appendages.items()
        }
        has_payload = any(isinstance(a.shape, Beam) and a.shape.tip_body for a in changed.values())
        if payload != 1.0 and not has_payload:
            raise BadInput("no appendage has a tip_body", key="payload", value=payload)
        return replace(self, appendages=changed)

    def heavier(self, factor: float) -> "SpacecraftTestbed":
        """Return it with the platform's mass and inertia times a factor (ScalableInertia)."""
        p = self.platform
        inertia = Inertia(**{key: factor * value for key, value in vars(p.inertia).items()})
        return replace(self, platform=replace(p, mass=factor * p.mass, inertia=inertia))

    def turning(self, joint: str, modes: int | None = None) -> "SpacecraftTestbed":
        """Return the testbed with this joint alone, pivoting about its axis.

        The pivot is the body origin where forces can hold it there, else the centre of mass. Driven
        hinges stay where they start.
        """
        limit = next((d.limit for d in self.craft.drives if d.name == joint), 0.0)
        single_axis = self._with_initial_hinges()._pivoting(joint, self._axis(joint), limit, modes)
        return replace(single_axis, initial={k: v for k, v in self.initial.items() if k == joint})

    def turning_about(
        self, axis: Vector, limit: float, modes: int | None = None
    ) -> "SpacecraftTestbed":
        """Return the testbed pivoting about a body axis; see contract.ThreeAxes."""
        return self._with_initial_hinges()._pivoting("turn", axis, limit, modes)

    def rigid(self) -> "SpacecraftTestbed":
        """Return the testbed without modes; see contract.ThreeAxes."""
        parts = _fix_hinges(self.appendages, ("passive",))
        rigid_parts = {name: replace(a, only_modes=()) for name, a in parts.items()}
        return replace(self, appendages=rigid_parts, sensors={}, initial_motion=None)

    def _with_initial_hinges(self) -> "SpacecraftTestbed":
        """Return it with its driven hinges at the angles where they start, counted from there."""
        parts = dict(self.appendages)
        for a in self.craft.appendages:
            angle = self.initial.get(f"{a.name}_hinge", 0.0)
            if angle and parts[a.name].hinge.kind == "driven":
                x, y, z = (rotation_matrix(a.axis, angle) @ a.axes).tolist()
                hinge = replace(
                    parts[a.name].hinge, axes=(tuple(x), tuple(y), tuple(z)), turned=None
                )
                parts[a.name] = replace(parts[a.name], hinge=hinge)
        return replace(self, appendages=parts)

    def _pivoting(
        self, joint: str, axis: Vector, limit: float, modes: int | None
    ) -> "SpacecraftTestbed":
        """Return the testbed with one joint that turns it about an axis."""
        spacecraft = self.craft
        place = pivot_point(spacecraft)
        units = UNITS[self.units]
        inertia = spacecraft.inertia.copy()
        for w in spacecraft.wheels:  # what spins freely about the axis does not turn along
            inertia -= w.inertia * np.outer(w.axis, w.axis)
        inertia /= units.torque
        parts = _fix_hinges(self.appendages, ("passive", "driven"))
        if modes is not None:
            parts = keep_largest_modes(spacecraft, parts, axis, place, modes)
        x, y, z = axis.tolist()
        return replace(
            self,
            platform=Platform(
                motion="pivot",
                mass=self.platform.mass,
                centre=self.platform.centre,
                inertia=Inertia(
                    xx=inertia[0, 0],
                    yy=inertia[1, 1],
                    zz=inertia[2, 2],
                    xy=inertia[0, 1],
                    xz=inertia[0, 2],
                    yz=inertia[1, 2],
                ),
                axis=(x, y, z),
                place=tuple((place / units.length).tolist()),
            ),
            appendages=parts,
            wheels={},
            control_moment_gyros={},
            sensors={},
            keep_out={},
            orbit=None,
            actuators={
                joint: ActuatorPlace(
                    kind="torque", direction=(x, y, z), limit=float(limit / units.torque)
                )
            },
            initial={},
            initial_motion=None,
        )

    def wheeled(self) -> "SpacecraftTestbed":
        """Return it with wheels that turn it as its gyros would without limits of their gimbals.

        Planners use them: the effect of a torque does not depend on its drive, and a law
        with an `allocation` steers the gimbals. They are light, so that they spin for themselves.
        """
        if not self.control_moment_gyros:
            return self
        spacecraft, torque = self.craft, UNITS[self.units].torque
        light = _LIGHT * float(np.linalg.eigvalsh(spacecraft.inertia).min()) / torque
        wheels = {
            g.name: WheelSettings(axis=(x, y, z), inertia=light, limit=d.limit / torque)
            for g in spacecraft.gyros
            for x, y, z in [g.across.tolist()]
            for d in spacecraft.drives
            if d.name == g.name
        }
        sensors: dict[str, AnySensor] = {
            name: sensor
            for name, sensor in self.sensors.items()
            if not isinstance(sensor, ResolverSettings)
        }
        all_wheels = {**self.wheels, **wheels}
        return replace(
            self, control_moment_gyros={}, wheels=all_wheels, sensors=sensors, initial_motion=None
        )

    def rigid_turn(self, joint: str) -> RigidTurn:
        """Return what forces and torques turn the rigid spacecraft; see contract.Turning."""
        return rigid_rotation_efforts(self._with_initial_hinges().craft, self._axis(joint))

    def rigid_turn_about(self, axis: Vector) -> RigidTurn:
        """Return what all joints do in a turn about an axis; see contract.ThreeAxes.

        Wheels and gyros alone leave no momentum, so there is nothing centrifugal.
        """
        found = rigid_rotation_efforts(self._with_initial_hinges().craft, axis)
        if all(d.what in (at.WHEEL, at.GYRO) for d in self.craft.drives):
            return found._replace(centrifugal=np.zeros_like(found.centrifugal))
        return found

    def _axis(self, joint: str) -> Vector:
        """Return the body axis about which a joint turns the platform, a unit vector."""
        axis_by_joint: dict[str, Vector] = {
            d.name: axis
            for d, axis in zip(self.craft.drives, rotation_axes(self.craft), strict=True)
            if d.what in (at.TORQUE, at.WHEEL, at.GYRO)
        }
        if joint not in axis_by_joint:
            hinges = {d.name for d in self.craft.drives if d.what == at.HINGE}
            hint = "; method joint_trajectory moves a hinge" if joint in hinges else ""
            raise BadInput(
                f"plan: goal: {joint} does not turn the platform; allowed: "
                f"{', '.join(axis_by_joint) or 'none, as no joint does'}{hint}"
            )
        return axis_by_joint[joint]

    def motions(self, position: Matrix, velocity: Matrix, goal: dict[str, float]) -> Motions:
        """Return what platform and tips do; see motions.Pointing."""
        return motions(self.craft, position, velocity, self.model().rest(goal))

    def drive_map(self) -> DriveMap:
        """Return what its drives do to its turn; see contract.TurnedByDrives."""
        return actuator_map(self.craft)

    def doubts(self) -> tuple[str, ...]:
        """Return what its appendages are unlikely to be; see contract.HasDoubts."""
        found = tuple(filter(None, map(mass_warning, self.craft.appendages)))
        return (*found, *model_warnings(self.appendages))

    def spins(self, velocity: Matrix) -> Spins:
        """Return what its wheels store; see motions.Pointing."""
        return spins(self.craft, velocity)

    def lines_of_sight(
        self, time: Vector, position: Matrix, goal: dict[str, float]
    ) -> dict[str, LineOfSight]:
        """Return where antennas look; see lines_of_sight.HasLinesOfSight."""
        if not any(a.manoeuvres for a in self.craft.appendages):  # as many, thousands of times
            return {}
        return lines_of_sight(self.craft, time, position, self.model().rest(goal))

    def clamped(self, name: str) -> Clamped:
        """Return an appendage clamped to the platform; see clamped.HasClampedAppendages."""
        return clamped(self.craft, name, self.model().appendages.names)

    def unit_sizes(self) -> UnitSizes:
        """Return the units of the section; see contract.OwnUnits."""
        return section_units(self.craft, UNITS[self.units])

    def hinge_turns(self) -> tuple[HingeTurn, ...]:
        """Return the prescribed turns; see contract.Retargetable."""
        return prescribed_rotations(self.craft)

    def retargeted(self, requested: dict[str, Any], at: float) -> dict[str, Any]:
        """Return the keys that give an appendage a new target; see contract.Retargetable."""
        return new_target_keys(self.appendages, requested, at)

    def floating(self) -> Floating | None:
        """Return how a free platform moves; see contract.CanFloat."""
        return floating(self.craft, self.model())

    def scene(self) -> Scene:
        """Return how it is drawn."""
        return scene_of(self.craft)


def _file_stamps(testbed: SpacecraftTestbed) -> tuple[tuple[str, int, int], ...]:
    """Return path, time of change and size of each file of data that a section reads.

    They are those of the first call: a section has one model, whatever becomes of its files.
    """
    known: tuple[tuple[str, int, int], ...] | None = vars(testbed).get(_STAMPS)
    if known is None:
        named = [getattr(a.shape, "file", None) for a in testbed.appendages.values()]
        files = [file for path in named if path is not None for file in files_of(path)]
        stats = [(file, file.stat()) for file in files if os.path.isfile(file)]
        known = tuple((str(file), stat.st_mtime_ns, stat.st_size) for file, stat in stats)
        vars(testbed)[_STAMPS] = known
    return known


class _Same:
    """A section as a key of a cache, with the state of the files that it names.

    The same object is the same key.
    """

    def __init__(self, testbed: SpacecraftTestbed) -> None:
        self.testbed, self.stamps = testbed, _file_stamps(testbed)

    def __hash__(self) -> int:
        """Of its names and its platform: all numbers take two milliseconds, at every `model`."""
        one = self.testbed
        return hash((*one.appendages, *one.wheels, *one.actuators, *one.sensors, one.platform))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, _Same):
            return False
        same_files = self.stamps == other.stamps
        return self.testbed is other.testbed or (same_files and self.testbed == other.testbed)


@lru_cache(maxsize=128)  # more than fly in a batch at once
def _spacecraft(same: _Same) -> Spacecraft:
    return build_spacecraft(same.testbed)


def _fix_hinges(
    parts: dict[str, AppendageSettings], kinds: tuple[str, ...]
) -> dict[str, AppendageSettings]:
    """Return the appendages with hinges of some kinds fixed: no plan counts with their motion."""
    return {
        name: replace(
            a,
            hinge=replace(a.hinge, kind="fixed", spring=0.0, damper=0.0, limit=Hinge.limit),
        )
        if a.hinge.kind in kinds
        else a
        for name, a in parts.items()
    }


def _loaded(shape: Any, payload: float) -> Any:
    """Return a shape with a tip body that weighs `payload` times as much."""
    if payload == 1.0 or not isinstance(shape, Beam) or shape.tip_body is None:
        return shape
    body = shape.tip_body
    inertia = Inertia(**{key: payload * value for key, value in vars(body.inertia).items()})
    return replace(
        shape, tip_body=Body(mass=payload * body.mass, centre=body.centre, inertia=inertia)
    )


@lru_cache(maxsize=128)
def _model(same: _Same) -> Model:
    spacecraft = same.testbed.craft
    p = packed(spacecraft)
    actuator_list = spacecraft.drives
    free = spacecraft.motion == at.FREE
    axes, motors = rotation_axes(spacecraft), motors_of(spacecraft)
    environment = same.testbed.orbit, same.testbed.wheels, UNITS[same.testbed.units]
    return Model(
        FLOATING if free else CONSTRAINED,
        p,
        tuple(d.name for d in actuator_list),
        tuple(position_unit(d) for d in actuator_list),
        spacecraft.modes,
        same.testbed.channels(spacecraft),
        scale_stiffness=lambda packed_, factor: scale_stiffness(spacecraft, packed_, factor),
        time_varying=any(a.manoeuvres for a in spacecraft.appendages),
        from_time=lambda packed_, time: shift_time(spacecraft, packed_, time),
        leading=spacecraft.sizes[1] - spacecraft.modes,
        known_as=coordinates(spacecraft),
        reading=lambda x: _read(p, x, len(actuator_list)),
        rest_position=_rest_position_map(spacecraft, axes),
        motors=motors,
        spins=reaction_wheels_of(spacecraft, motors),
        attitude=attitude_joints(axes) if free else None,
        outside=outside_of(spacecraft, *environment) if free else None,
        one_way=tuple(k for k, d in enumerate(actuator_list) if d.what == at.THRUSTER),
        gimbals=tuple(range(*_gimbals(spacecraft))),
        gyros=tuple(k for k, d in enumerate(actuator_list) if d.what == at.GYRO),
    )


def _rest_position_map(
    spacecraft: Spacecraft, axes: Matrix
) -> Callable[[Mapping[str, float]], Vector]:
    """Return `placed` of a craft, which metrics ask for one goal at every block of a run."""

    @lru_cache(maxsize=4)
    def cached_rest(positions: tuple[tuple[str, float], ...]) -> Vector:
        return rest_position(spacecraft, axes, dict(positions))

    return lambda positions: cached_rest(tuple(positions.items())).copy()


def _gimbals(spacecraft: Spacecraft) -> tuple[int, int]:
    """Return where the angles of its gimbals begin in v, and end."""
    end = spacecraft.sizes[1] - spacecraft.modes
    return end - len(spacecraft.gyros), end


def _read(p: Vector, x: Vector, count: int) -> tuple[Vector, Vector]:
    position, velocity = np.empty(count), np.empty(count)
    read(p, x, position, velocity)
    return position, velocity


SPACECRAFT = TestbedEntry(
    SpacecraftTestbed,
    {
        "appendages": {
            "boom": {
                "shape": {
                    "kind": "beam",
                    "length": 10.0,
                    "linear_density": 0.5,
                    "bending_stiffness": 500.0,
                    "modes": 2,
                },
                "damping": {"ratio": 0.02},
            }
        }
    },
)
