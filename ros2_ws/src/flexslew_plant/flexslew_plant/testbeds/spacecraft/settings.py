"""Sections of a spacecraft in a trial file: platform, appendages, wheels, actuators."""

from pathlib import Path
from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from flexslew_plant.settings import NonNegative, Positive, section

Triple: TypeAlias = tuple[float, float, float]
Rows: TypeAlias = tuple[Triple, Triple, Triple]

IDENTITY: Rows = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@section
class Inertia:
    """Entries of an inertia matrix: xy is -(product of inertia), the matrix entry."""

    xx: float = 0.0
    yy: float = 0.0
    zz: float = 0.0
    xy: float = 0.0
    xz: float = 0.0
    yz: float = 0.0


@section
class Body:
    """A rigid body in the axes of what it belongs to."""

    mass: float
    centre: Triple = (0.0, 0.0, 0.0)  # of mass, from the origin
    inertia: Inertia = Inertia()  # about the origin (of a tip body: about its centre)


@section
class Platform:
    """The rigid platform. Its axes are the body axes; roll, pitch, yaw turn about x, y, z."""

    motion: Literal["free", "held", "pivot"] = "free"
    mass: float = 100.0
    centre: Triple = (0.0, 0.0, 0.0)  # of mass, in body axes
    inertia: Inertia = Inertia(xx=50.0, yy=50.0, zz=50.0)  # about the body origin
    axis: Triple = (1.0, 0.0, 0.0)  # of a pivot, in body axes
    place: Triple = (0.0, 0.0, 0.0)  # of a pivot, in body axes


@section
class Turn:
    """A turn about an axis."""

    axis: Triple
    angle: float  # [rad]


@section
class Motion:
    """A prescribed turn of a hinge, from where the one before has ended."""

    to: float | None = None  # angle from the hinge's rest [rad]
    # instead: where its z shall point, in inertial space with the platform at rest
    line_of_sight: Triple | None = None
    duration: Positive  # [s]
    at: NonNegative = 0.0  # when it begins [s]
    profile: Literal["smooth", "bang_bang", "table"] = "smooth"
    axis: Triple | None = None  # left out: the hinge's
    # rows (time over duration, share of the turn, its first and second derivative)
    table: tuple[tuple[float, float, float, float], ...] = ()


@section
class Hinge:
    """Where an appendage is joined to the platform, and how."""

    kind: Literal["fixed", "prescribed", "driven"] | None = None  # null: prescribed with a motion
    place: Triple = (0.0, 0.0, 0.0)  # r_o, in body axes
    axes: Rows = IDENTITY  # the appendage's x, y, z in body axes
    turned: Turn | None = None  # of these axes, before anything moves
    axis: Triple = (1.0, 0.0, 0.0)  # about which it turns, in appendage axes
    range: tuple[float, float] | None = None  # of its angle [rad]
    spring: NonNegative = 0.0  # of a driven hinge
    damper: NonNegative = 0.0
    limit: Positive = 100.0  # of its motor; its joint is called <appendage>_hinge
    motion: Motion | tuple[Motion, ...] | None = None


@section
class Beam:
    """A clamped uniform beam."""

    kind: Literal["beam"] = "beam"
    method: Literal["finite_elements", "closed_form"] = "finite_elements"
    length: Positive
    linear_density: Positive
    # EI against deflection across and along the third axis; one number: both
    bending_stiffness: Positive | tuple[Positive, Positive]
    torsion_stiffness: NonNegative = 0.0  # GJ; 0: it does not twist
    polar_inertia: NonNegative = 0.0  # per length, about the beam
    along: Triple = (0.0, 0.0, 1.0)  # its direction in appendage axes
    across: Triple = (1.0, 0.0, 0.0)  # its first deflection
    elements: Annotated[int, Field(ge=1, le=200)] = 26
    modes: Annotated[int, Field(ge=0, le=60)] = 4  # of finite elements, the slowest
    modes_across: Annotated[int, Field(ge=0, le=12)] = 2  # in closed form
    modes_third: Annotated[int, Field(ge=0, le=12)] = 2
    modes_twist: Annotated[int, Field(ge=0, le=12)] = 0
    tip_body: Body | None = None  # in appendage axes, its centre from the beam's end


@section
class Membrane:
    """A circular membrane with a fixed rim, across the appendage's z."""

    kind: Literal["membrane"] = "membrane"
    radius: Positive
    density: Positive  # per area
    wave_speed: Positive  # c
    height: float = 0.0  # above the hinge
    waves: Annotated[int, Field(ge=0, le=6)] = 2
    rings: Annotated[int, Field(ge=1, le=6)] = 2
    poisson_ratio: Annotated[float, Field(ge=0.0, le=0.5)] = 0.3  # for the geometric stiffness


@section
class ModalData:
    """Modes from a file of a finite element program; see modal_file."""

    kind: Literal["modal_data"] = "modal_data"
    file: Path
    modes: Annotated[int, Field(ge=1)] | None = None  # the first; left out: all


@section
class Damping:
    """C = alpha M + beta K plus ratios of the clamped modes."""

    alpha: NonNegative = 0.0  # [1/s]
    beta: NonNegative = 0.0  # [s]
    # one for all, or one per mode [-]
    ratio: (
        Annotated[float, Field(ge=0.0, lt=1.0)]
        | tuple[Annotated[float, Field(ge=0.0, lt=1.0)], ...]
    ) = 0.0


Shape: TypeAlias = Annotated[Beam | Membrane | ModalData, Field(discriminator="kind")]


@section
class AppendageSettings:
    """One appendage: a hinge, a flexible shape, a rigid body, or both."""

    hinge: Hinge = Hinge()
    shape: Shape | None = None
    body: Body | None = None  # rigid, at the hinge
    damping: Damping = Damping()
    second_order: bool = True  # terms of second order in the deflections
    # of a base that spins or accelerates, of second order too; null: where the shape says how
    geometric_stiffness: bool | None = None
    only_modes: tuple[Annotated[int, Field(ge=1)], ...] | None = None  # that count; null: all
    stiffness: Positive = 1.0  # factor on the modal stiffness [-]


@section
class WheelSettings:
    """A reaction wheel; its mass and inertia at rest belong to the platform's."""

    axis: Triple
    inertia: Positive  # about its axis
    limit: Positive  # of its motor
    momentum_limit: Positive | None = None  # largest inertia times speed
    speed_limit: Positive | None = None  # [rad/s]


@section
class ActuatorPlace:
    """A force or a torque on the platform or on an appendage, or a modal force.

    A modal force is spread over an appendage as its mass times a mode: it drives that mode and no
    other, and acts on the platform by its resultant.
    """

    kind: Literal["force", "torque", "modal"]
    direction: Triple = (0.0, 0.0, 0.0)  # in the axes of what it acts on; not of a modal force
    limit: Positive
    appendage: str | None = None  # left out: on the platform
    mode: Annotated[int, Field(ge=1)] | None = None  # of a modal force, counted from 1
    at: float | None = None  # along its beam; left out: its tip
    place: Triple = (0.0, 0.0, 0.0)  # on the platform


@section
class SensorPlace:
    """A sensor on an appendage, or an accelerometer on the platform; errors in its own unit."""

    kind: Literal["displacement", "rate", "strain", "accelerometer"]
    appendage: str | None = None  # left out: an accelerometer on the platform
    at: float | None = None  # along its beam; left out: its tip, of a strain its root
    direction: Triple = (1.0, 0.0, 0.0)  # in the axes of what it sits on
    fibre: Triple = (0.0, 0.0, 0.0)  # of a strain: from the beam's centre line
    place: Triple = (0.0, 0.0, 0.0)  # on the platform
    noise: NonNegative = 0.0  # standard deviation of white noise, each tick
    bias: float = 0.0
    quantisation: NonNegative = 0.0
