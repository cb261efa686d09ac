"""Sections of a spacecraft in a trial file: platform, appendages, wheels, actuators."""

from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import numpy as np
from pydantic import AfterValidator, Field, ValidationInfo

from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import NO_CODE
from flexslew_plant.settings import NonNegative, Positive, section
from flexslew_plant.testbeds.instruments import (
    GyroSettings,
    ResolverSettings,
    StarTrackerSettings,
    SunSensorSettings,
    TachometerSettings,
)
from flexslew_plant.testbeds.spacecraft.shapes.modal_file import allowed_file

Triple: TypeAlias = tuple[float, float, float]
Rows: TypeAlias = tuple[Triple, Triple, Triple]

IDENTITY: Rows = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@section
class Inertia:
    """Entries of an inertia matrix: xy is -(product of inertia), the matrix entry."""

    xx: float = 0.0  # entry of the inertia [kg m^2 or slug ft^2]
    yy: float = 0.0  # entry of the inertia [kg m^2 or slug ft^2]
    zz: float = 0.0  # entry of the inertia [kg m^2 or slug ft^2]
    # entry itself, minus the product of inertia [kg m^2 or slug ft^2]
    xy: float = 0.0
    # entry itself, minus the product of inertia [kg m^2 or slug ft^2]
    xz: float = 0.0
    # entry itself, minus the product of inertia [kg m^2 or slug ft^2]
    yz: float = 0.0


@section
class Body:
    """A rigid body in the axes of what it belongs to."""

    mass: float  # of the body [kg or slug]
    centre: Triple = (0.0, 0.0, 0.0)  # of mass, from the origin [m or ft]
    inertia: Inertia = Inertia()  # about the origin (of a tip body: about its centre)


@section
class Platform:
    """The rigid platform. Its axes are the body axes; roll, pitch, yaw turn about x, y, z."""

    # free in space, held, or turning about a pivot
    motion: Literal["free", "held", "pivot"] = "free"
    mass: float = 100.0  # of the platform, without appendages [kg or slug]
    centre: Triple = (0.0, 0.0, 0.0)  # centre of mass, in body axes [m or ft]
    # entries of the inertia about the body origin
    inertia: Inertia = Inertia(xx=50.0, yy=50.0, zz=50.0)
    axis: Triple = (1.0, 0.0, 0.0)  # of a pivot, in body axes
    place: Triple = (0.0, 0.0, 0.0)  # of a pivot, in body axes [m or ft]


@section
class Turn:
    """A turn about an axis."""

    axis: Triple  # of the turn, of any length
    angle: float  # of the turn [rad]


@section
class Motion:
    """A prescribed turn of a hinge, from where the one before has ended."""

    to: float | None = None  # angle at which a prescribed turn ends, from the hinge's rest [rad]
    # instead of `to`: where the appendage's z shall point, in inertial space, the platform at rest
    line_of_sight: Triple | None = None
    duration: Positive  # of the turn [s]
    at: NonNegative = 0.0  # when the turn begins [s]
    profile: Literal["smooth", "bang_bang", "table"] = "smooth"  # of the turn
    axis: Triple | None = None  # null: the hinge's
    # rows: time over duration, share of the turn, its first and second derivative
    table: tuple[tuple[float, float, float, float], ...] = ()


@section
class Hinge:
    """Where an appendage is joined to the platform, and how."""

    # null: prescribed when it has a motion, else fixed; driven: by a motor; passive: without one
    kind: Literal["fixed", "prescribed", "driven", "passive"] | None = None
    place: Triple = (0.0, 0.0, 0.0)  # of the hinge, in body axes [m or ft]
    axes: Rows = IDENTITY  # rows: the appendage's x, y, z in body axes
    turned: Turn | None = None  # a turn of these axes before anything moves: `axis` and `angle`
    axis: Triple = (1.0, 0.0, 0.0)  # about which it turns, in appendage axes
    range: tuple[float, float] | None = None  # smallest and largest angle of the hinge [rad]
    spring: NonNegative = 0.0  # stiffness of a driven or passive hinge [N m/rad or lb ft/rad]
    # damping of a driven or passive hinge [N m s/rad or lb ft s/rad]
    damper: NonNegative = 0.0
    # largest effort of a driven hinge, whose joint is NAME_hinge [N m or lb ft]
    limit: Positive = 100.0
    motion: Motion | tuple[Motion, ...] | None = None  # its prescribed turns


@section
class Beam:
    """A clamped uniform beam."""

    kind: Literal["beam"] = "beam"
    # how its modes are found
    method: Literal["finite_elements", "closed_form"] = "finite_elements"
    length: Positive  # length of the beam [m or ft]
    linear_density: Positive  # mass per length [kg/m or slug/ft]
    # EI; two numbers: across, and along the third axis [N m^2 or lb ft^2]
    bending_stiffness: Positive | tuple[Positive, Positive]
    torsion_stiffness: NonNegative = 0.0  # GJ; 0: it does not twist [N m^2 or lb ft^2]
    polar_inertia: NonNegative = 0.0  # per length, about the beam [kg m or slug ft]
    along: Triple = (0.0, 0.0, 1.0)  # direction of the beam in appendage axes
    across: Triple = (1.0, 0.0, 0.0)  # direction of its first deflection
    elements: Annotated[int, Field(ge=1, le=200)] = 26  # number of finite elements
    modes: Annotated[int, Field(ge=0, le=60)] = 4  # of finite elements, the slowest
    modes_across: Annotated[int, Field(ge=0, le=12)] = 2  # across, in closed form
    modes_third: Annotated[int, Field(ge=0, le=12)] = 2  # along the third axis, in closed form
    modes_twist: Annotated[int, Field(ge=0, le=12)] = 0  # of the twist, in closed form
    # rigid body at the tip, in appendage axes, its centre from the beam's end
    tip_body: Body | None = None


@section
class Membrane:
    """A circular membrane with a fixed rim, across the appendage's z."""

    kind: Literal["membrane"] = "membrane"
    radius: Positive  # of the fixed rim [m or ft]
    density: Positive  # mass per area [kg/m^2 or slug/ft^2]
    wave_speed: Positive  # c [m/s or ft/s]
    height: float = 0.0  # of the membrane above the hinge [m or ft]
    waves: Annotated[int, Field(ge=0, le=6)] = 2  # largest number of waves round the rim
    rings: Annotated[int, Field(ge=1, le=6)] = 2  # number of rings
    # how its in-plane stress spreads, for the geometric stiffness [-]
    poisson_ratio: Annotated[float, Field(ge=0.0, le=0.5)] = 0.3


def _allowed_file(path: Path, info: ValidationInfo) -> Path:
    """Return the file, if values from where these come may name it."""
    try:
        return allowed_file(path, info.context or NO_CODE)
    except BadInput as error:
        raise ValueError(str(error)) from error  # from which `validated` makes an Untrusted


@section
class ModalData:
    """Modes from a file of a finite element program; see modal_file."""

    kind: Literal["modal_data"] = "modal_data"
    file: Annotated[
        Path, AfterValidator(_allowed_file)
    ]  # with frequencies and shapes or participation, see Modal data
    modes: Annotated[int, Field(ge=1)] | None = None  # the first; null: all


@section
class FiniteElements:
    """A finite element model, reduced to its clamped modes; see finite_elements."""

    kind: Literal["finite_elements"] = "finite_elements"
    # of mass and stiffness: .npz, .mat, .op4, .op2 or .pch of Nastran, .inp of CalculiX; of clamped
    # modes: its .frd; see Finite elements
    file: Annotated[Path, AfterValidator(_allowed_file)]
    # what the hinge holds: node numbers or ranges (`5-9`), node sets, planes (`x=0`); of a file
    # without nodes: rows from 1; empty: the boundary that the file names
    boundary: tuple[int | str, ...] = ()
    modes: Annotated[int, Field(ge=1, le=200)] = 8  # the slowest
    # of the model: si, slug_ft_lb, mm_t_s or in_lbf_s
    units: Literal["si", "slug_ft_lb", "mm_t_s", "in_lbf_s"] = "si"
    # place of the hinge in the model; null: the centre of the boundary [m, ft, mm or in]
    origin: Triple | None = None
    tip: int | None = None  # number of the node that is reported as the tip; null: the farthest
    # of all modes; null: that of the file's damping matrix, or none [-]
    damping_ratio: Annotated[float, Field(ge=0.0, lt=1.0)] | None = None


@section
class Damping:
    """C = alpha M + beta K plus ratios of the clamped modes."""

    alpha: NonNegative = 0.0  # share of the mass matrix [1/s]
    beta: NonNegative = 0.0  # share of the stiffness [s]
    # damping ratio of all clamped modes, or one per mode [-]
    ratio: (
        Annotated[float, Field(ge=0.0, lt=1.0)]
        | tuple[Annotated[float, Field(ge=0.0, lt=1.0)], ...]
    ) = 0.0


Shape: TypeAlias = Annotated[
    Beam | Membrane | ModalData | FiniteElements, Field(discriminator="kind")
]


@section
class AppendageSettings:
    """One appendage: a hinge, a flexible shape, a rigid body, or both."""

    hinge: Hinge = Hinge()  # where it is joined, and how
    shape: Shape | None = None  # what is flexible: a `kind` of shape
    body: Body | None = None  # a rigid body at the hinge
    damping: Damping = Damping()  # C = alpha M + beta K, plus ratios of the clamped modes
    second_order: bool = True  # whether terms of second order in the deflections count
    # whether a base that spins or accelerates stiffens or softens it; null: where the shape says
    # how
    geometric_stiffness: bool | None = None
    # numbers of the modes that count, from 1; null: all
    only_modes: tuple[Annotated[int, Field(ge=1)], ...] | None = None
    stiffness: Positive = 1.0  # factor on the modal stiffness [-]


@section
class Harmonic:
    """A force and a torque that turn in the plane across a wheel's axis, `order` times as fast.

    Both grow by the square of the wheel's speed. At phase zero and the wheel's angle zero they are
    along the body's x without its part along the axis (its y where that is nearer to the axis).
    """

    order: Positive  # turns per turn of the wheel [-]
    # per square of the wheel's speed, as of a mass times a radius [kg m or slug ft]
    force: NonNegative = 0.0
    force_phase: float = 0.0  # at the wheel's angle zero [rad]
    # per square of the wheel's speed, as a product of inertia [kg m^2 or slug ft^2]
    torque: NonNegative = 0.0
    torque_phase: float = 0.0  # at the wheel's angle zero [rad]


@section
class WheelSettings:
    """A reaction wheel; its mass and inertia at rest belong to the platform's."""

    axis: Triple  # in body axes; a positive effort turns the platform about it
    inertia: Positive  # about its axis [kg m^2 or slug ft^2]
    limit: Positive  # of its motor [N m or lb ft]
    # inertia times speed of a wheel up to which its motor drives it: the tick in which it gets
    # there has the impulse that is left, and the efforts of the log are those that acted; what
    # the platform's own turn, or a disturbance, adds to the speed is held by nobody
    # [N m s or lb ft s]
    momentum_limit: Positive | None = None
    speed_limit: Positive | None = None  # the same for its speed [rad/s]
    # of the wheel in body axes, where its imbalance pushes [m or ft]
    place: Triple = (0.0, 0.0, 0.0)
    # mass times radius: a harmonic of order 1, phase 0 [kg m or slug ft]
    static_imbalance: NonNegative = 0.0
    # product of inertia: likewise [kg m^2 or slug ft^2]
    dynamic_imbalance: NonNegative = 0.0
    harmonics: tuple[Harmonic, ...] = ()  # further ones of its disturbance


@section
class MomentGyroSettings:
    """A control moment gyro with one gimbal; its servo has the lag of the actuators.

    An effort is the torque on the platform that its gimbal gives at the angle where it stands.
    """

    axis: Triple  # of its gimbal, in body axes
    # direction of the rotor's momentum at gimbal angle zero, at right angles to the axis; a
    # positive effort then turns the platform about axis x rotor
    rotor: Triple
    momentum: Positive  # of its rotor [N m s or lb ft s]
    rate_limit: Positive = 1.0  # largest rate of its gimbal [rad/s]


@section
class ActuatorPlace:
    """A force or a torque on the platform or on an appendage, a thruster, or a modal force.

    A modal force is spread over an appendage as its mass times a mode: it drives that mode and no
    other, and acts on the platform by its resultant. A thruster pushes the platform one way.
    """

    kind: Literal["force", "torque", "thruster", "modal"]  # what it gives
    # of a force, a torque or a thruster's push, in the axes of what it acts on
    direction: Triple = (0.0, 0.0, 0.0)
    limit: Positive  # largest effort [N or lb; torque: N m or lb ft]
    appendage: str | None = None  # on which an actuator acts; null: on the platform
    # of a modal force, from 1; it is spread over the appendage as its mass times that mode
    mode: Annotated[int, Field(ge=1)] | None = None
    at: float | None = None  # its place along the beam [m or ft]; null: the tip
    place: Triple = (0.0, 0.0, 0.0)  # on the platform [m or ft]


@section
class KeepOut:
    """A cone in the sky that an axis of the platform must not look into."""

    # which must keep out of it, in body axes, of any length
    boresight: Triple = (0.0, 0.0, 1.0)
    # of the cone's axis, in inertial space, of any length; null: to the Sun of `orbit`
    direction: Triple | None = None
    half_angle: Annotated[float, Field(gt=0.0, lt=np.pi)]  # of the cone [rad]


@section
class SensorPlace:
    """A sensor on an appendage, or an accelerometer on the platform; errors in its own unit."""

    # what it reads; the units of its errors below hold in slug_ft_lb, too
    kind: Literal["displacement", "rate", "strain", "accelerometer"]
    appendage: str | None = None  # on which it sits; null: an accelerometer on the platform
    # its place along the beam [m or ft]; null: the tip, of a strain the root
    at: float | None = None
    direction: Triple = (1.0, 0.0, 0.0)  # in which it reads, in the axes of what it sits on
    # of a strain: its place from the beam's centre line, in appendage axes [m or ft]
    fibre: Triple = (0.0, 0.0, 0.0)
    # of an accelerometer on the platform, in body axes [m or ft]
    place: Triple = (0.0, 0.0, 0.0)
    # standard deviation of its white noise, each tick
    # [displacement: m; rate: m/s; strain: -; accelerometer: m/s^2]
    noise: NonNegative = 0.0
    # added to every reading [displacement: m; rate: m/s; strain: -; accelerometer: m/s^2]
    bias: float = 0.0
    # readings are multiples of it; 0: none
    # [displacement: m; rate: m/s; strain: -; accelerometer: m/s^2]
    quantisation: NonNegative = 0.0


AnySensor: TypeAlias = Annotated[
    SensorPlace
    | GyroSettings
    | StarTrackerSettings
    | SunSensorSettings
    | TachometerSettings
    | ResolverSettings,
    Field(discriminator="kind"),
]
