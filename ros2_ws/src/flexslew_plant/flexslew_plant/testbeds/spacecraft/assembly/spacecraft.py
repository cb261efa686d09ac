"""From the sections of a trial file to a spacecraft in SI, checked."""

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.orientation.attitude import skew
from flexslew_plant.testbeds.spacecraft.assembly.appendages import appendage_of
from flexslew_plant.testbeds.spacecraft.assembly.bodies import rigid_body, unit_direction
from flexslew_plant.testbeds.spacecraft.assembly.craft import MomentGyro, Spacecraft, Wheel
from flexslew_plant.testbeds.spacecraft.assembly.described import SpacecraftSection
from flexslew_plant.testbeds.spacecraft.assembly.drives import make_actuator_list
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.settings import (
    Body,
    MomentGyroSettings,
    WheelSettings,
)
from flexslew_plant.testbeds.spacecraft.units import UNITS, Units

_MOTION_CODES = {"free": at.FREE, "held": at.HELD, "pivot": at.PIVOT}


def build_spacecraft(section: SpacecraftSection) -> Spacecraft:
    """Return the spacecraft in SI.

    Raises:
        BadInput: a body that cannot exist, directions that are not orthonormal, modes of the
            wrong shape, or a mass matrix that is not positive definite; with the numbers.
    """
    units, p = UNITS[section.units], section.platform
    mass, first, inertia = rigid_body(
        Body(mass=p.mass, centre=p.centre, inertia=p.inertia), units, "testbed.platform"
    )
    parts = tuple(
        appendage_of(name, a, units, f"testbed.appendages.{name}")
        for name, a in section.appendages.items()
    )
    wheels = tuple(
        Wheel(
            name,
            unit_direction(w.axis, f"testbed.wheels.{name}.axis"),
            w.inertia * units.torque,
            _largest_speed(w, units),
        )
        for name, w in section.wheels.items()
    )
    gyros = section.control_moment_gyros
    if gyros and p.motion != "free":
        raise BadInput(
            "turn a free platform alone; use motion: free", key="testbed.control_moment_gyros"
        )
    spacecraft = Spacecraft(
        mass,
        first,
        inertia,
        parts,
        wheels,
        make_actuator_list(section, parts, units),
        _MOTION_CODES[p.motion],
        unit_direction(p.axis, "testbed.platform.axis"),
        np.array(p.place) * units.length,
        tuple(_gyro(name, g, units) for name, g in gyros.items()),
    )
    require_positive_definite(spacecraft)
    return spacecraft


def require_positive_definite(spacecraft: Spacecraft) -> None:
    """Check the mass matrix at rest, one appendage after another.

    Raises:
        BadInput: names the appendage and the lowest eigenvalue, masses scaled to one.
    """
    mass, first, inertia = spacecraft.mass, spacecraft.first.copy(), spacecraft.inertia.copy()
    for w in spacecraft.wheels:
        inertia = inertia - w.inertia * np.outer(w.axis, w.axis)
    blocks, modal = [np.zeros((6, 0))], np.zeros(0)
    for a in (None, *spacecraft.appendages):
        if a is not None:
            seen = a.integrals.seen_from(a.place, a.axes)
            mass, first, inertia = mass + seen.mass, first + seen.first, inertia + seen.inertia
            blocks.append(np.vstack((seen.translation, seen.rotation)))
            modal = np.concatenate((modal, a.mass))
        modal_block = np.hstack(blocks)
        full = np.block(
            [[_rigid_block(mass, first, inertia), modal_block], [modal_block.T, np.diag(modal)]]
        )
        scale = 1.0 / np.sqrt(abs(np.diag(full)))
        lowest = float(np.linalg.eigvalsh(scale[:, None] * full * scale).min())
        if not lowest > 1e-12:
            part = "wheels" if a is None else f"appendages.{a.name}"
            raise BadInput(
                f"testbed.{part}: the mass matrix with the platform is not positive definite: "
                f"lowest eigenvalue {lowest:.3g} (diagonal scaled to one); "
                "check its masses, inertias and participation factors"
            )


def _rigid_block(mass: float, first: Vector, inertia: Matrix) -> Matrix:
    across = skew(first)
    return np.block([[mass * np.eye(3), -across], [across, inertia]])


def _gyro(name: str, g: MomentGyroSettings, units: Units) -> MomentGyro:
    """Return a gyro in SI.

    Raises:
        BadInput: its rotor does not lie across its gimbal.
    """
    key = f"testbed.control_moment_gyros.{name}"
    axis, rotor = unit_direction(g.axis, f"{key}.axis"), unit_direction(g.rotor, f"{key}.rotor")
    if abs(axis @ rotor) > 1e-6:
        words = f"at right angles to its gimbal's axis, {list(g.axis)}"
        raise BadInput(words, key=f"{key}.rotor", value=list(g.rotor))
    return MomentGyro(name, axis, rotor, g.momentum * units.torque)


def _largest_speed(w: WheelSettings, units: Units) -> float:
    """Return the lower of a wheel's two limits [rad/s]."""
    by_momentum = np.inf if w.momentum_limit is None else w.momentum_limit / w.inertia
    return float(min(by_momentum, np.inf if w.speed_limit is None else w.speed_limit))
