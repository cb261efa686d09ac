"""What the imbalance of reaction wheels does to a free platform.

Of a harmonic k of a wheel at the angle p and the speed W against the platform, across its axis
(Masterson, Miller and Grogan 2002):
    F = C_k W^2 (e1 cos(k p + a) + e2 sin(k p + a)),  at its place,   T = D_k W^2 (likewise),
e1, e2 and the axis an orthonormal triad. Static and dynamic imbalance are harmonics of order 1.
"""

from collections.abc import Mapping

import numpy as np

from flexslew_plant.arrays import Matrix, Vector, called
from flexslew_plant.testbeds.orientation.attitude import cross
from flexslew_plant.testbeds.spacecraft.assembly.craft import Spacecraft
from flexslew_plant.testbeds.spacecraft.settings import Harmonic, WheelSettings
from flexslew_plant.testbeds.spacecraft.units import Units

_PLATFORM_Q, _PLATFORM_V = 7, 6  # entries of a free platform in q and v

# the numbers of a harmonic: where the wheel's angle and speed stand in a state, k, the phases of F
# and T, then at a phase of zero and of a quarter of a turn: (F, its moment) / W^2, and T / W^2
_ANGLE, _SPEED, _ORDER, _FORCE_PHASE, _TORQUE_PHASE, _PUSH, _TORQUE = 0, 1, 2, 3, 4, 5, 17
_ROW_SIZE = 23


def harmonics_of(wheel: WheelSettings) -> tuple[Harmonic, ...]:
    """Return all that a wheel's disturbance consists of."""
    static, dynamic = wheel.static_imbalance, wheel.dynamic_imbalance
    first = (Harmonic(order=1.0, force=static, torque=dynamic),) if static or dynamic else ()
    return first + wheel.harmonics


def packed_imbalance(
    spacecraft: Spacecraft, wheels: Mapping[str, WheelSettings], units: Units
) -> Vector:
    """Return the numbers that add_imbalance reads, none where all wheels are balanced."""
    rows, first = [np.zeros(0)], len(spacecraft.hinged)
    for index, (wheel, known) in enumerate(zip(wheels.values(), spacecraft.wheels, strict=True)):
        angle = _PLATFORM_Q + first + index
        speed = spacecraft.sizes[0] + _PLATFORM_V + first + index
        plane, place = _plane_axes(known.axis), np.array(wheel.place) * units.length
        for one in harmonics_of(wheel):
            push = one.force * units.force * plane
            force_and_moment = np.hstack((push, cross(place, push)))
            head = [angle, speed, one.order, one.force_phase, one.torque_phase]
            rows.append(
                np.concatenate((head, *force_and_moment, *(one.torque * units.torque * plane)))
            )
    return np.concatenate(rows)


@called
def add_imbalance(harmonics: Vector, x: Vector, span: float, force: Vector) -> None:
    """Add the mean over a span from now of forces that turn at the speeds of the state.

    That of cos(k (p + W s)) is cos(k (p + W span / 2)) sin(h) / h, with h = k W span / 2.

    Args:
        harmonics: packed_imbalance.
        x: state.
        span: [s], which may be negative.
        force: generalised forces, in and out, shape (n,).
    """
    for at in range(0, harmonics.size, _ROW_SIZE):
        row = harmonics[at : at + _ROW_SIZE]
        angle, speed = x[int(row[_ANGLE])], x[int(row[_SPEED])]
        half = 0.5 * row[_ORDER] * speed * span
        middle = row[_ORDER] * angle + half
        size = speed * speed * (np.sin(half) / half if half != 0.0 else 1.0)
        c, s = np.cos(middle + row[_FORCE_PHASE]), np.sin(middle + row[_FORCE_PHASE])
        for i in range(6):
            force[i] += size * (c * row[_PUSH + i] + s * row[_PUSH + 6 + i])
        c, s = np.cos(middle + row[_TORQUE_PHASE]), np.sin(middle + row[_TORQUE_PHASE])
        for i in range(3):
            force[3 + i] += size * (c * row[_TORQUE + i] + s * row[_TORQUE + 3 + i])


def _plane_axes(axis: Vector) -> Matrix:
    """Return e1 and e2, which with the axis are right-handed, shape (2, 3)."""
    along = np.eye(3)[0 if abs(axis[0]) < np.sqrt(0.5) else 1]
    first = along - (along @ axis) * axis
    first = first / np.linalg.norm(first)
    return np.array([first, cross(axis, first)])
