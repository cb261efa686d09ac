"""A torque shared out among the drives of craft side by side, as machine code."""

from collections.abc import Hashable, Sequence
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.allocation.gyro_set import NO_GYROS, GyroNumbers, gyro_efforts
from flexslew_control.allocation.thruster_set import (
    NO_THRUSTERS,
    ThrusterNumbers,
    thruster_efforts,
)
from flexslew_control.allocation.wheel_set import NO_WHEELS, WheelNumbers, wheel_efforts
from flexslew_plant.arrays import Indices, Tensor, Vector, called, compiled_once

NONE: Indices = np.zeros(0, dtype=np.int64)


class ActuatorIndices(NamedTuple):
    """Which joints take part, and the readings of their states; the same in all members."""

    wheels: Indices = NONE
    speeds: Indices = NONE  # of the wheels, among the readings of the tips; none: not measured
    thrusters: Indices = NONE
    gyros: Indices = NONE
    angles: Indices = NONE  # of their gimbals, among the readings of the tips


class AllocationNumbers(NamedTuple):
    """The data of an Allocator for several spacecraft, a row each."""

    drives: ActuatorIndices
    torque: Tensor  # of a unit effort of each joint, (members, 3, joints)
    unloading: Vector  # (members,) [1/s]
    wheels: WheelNumbers = NO_WHEELS
    thrusters: ThrusterNumbers = NO_THRUSTERS
    gyros: GyroNumbers = NO_GYROS


def side_by_side(members: Sequence[Any]) -> Any:
    """Return numbers of one member each as those of all members; whole numbers are the first's."""
    first = members[0]
    if isinstance(first, tuple):
        return type(first)(*map(side_by_side, zip(*members, strict=True)))
    return first if first.dtype == np.int64 else np.concatenate(members)


def kind_of(numbers: Any) -> Hashable:
    """Return what is equal for numbers that may stand side by side."""
    if isinstance(numbers, tuple):
        return tuple(map(kind_of, numbers))
    found: Hashable = numbers.tobytes() if numbers.dtype == np.int64 else numbers.shape
    return found


@compiled_once("out")
def share(
    n: AllocationNumbers,
    member: int,
    torque: Vector,
    measurements: Vector,
    time: float,
    out: Vector,
) -> None:
    """Write the efforts of all joints that give a torque; see Allocator.efforts.

    Args:
        n: data of some members.
        member: index of the member.
        torque: about the centre of mass, in body axes, shape (3,) [N m].
        measurements: tip readings; empty: none are known, and gimbals stand at zero.
        time: simulated time [s].
        out: shape (joints,) [N m or N].
    """
    drives, measured = n.drives, measurements.size > 0
    for i in range(out.size):
        out[i] = 0.0
    if drives.gyros.size:
        efforts = np.empty(drives.gyros.size)
        angles = _read(measurements, drives.angles) if measured else np.zeros(efforts.size)
        gyro_efforts(n.gyros, member, torque, angles, time, efforts)
        _put(efforts, drives.gyros, out)
    elif drives.wheels.size:
        speeds = _read(measurements, drives.speeds) if measured else np.zeros(0)
        left, efforts = torque.copy(), np.empty(drives.wheels.size)
        if drives.thrusters.size and speeds.size:
            _remove_momentum(n, member, speeds, left, out)
        wheel_efforts(n.wheels, member, left, speeds, efforts)
        _put(efforts, drives.wheels, out)
    else:
        forces = np.empty(drives.thrusters.size)
        thruster_efforts(n.thrusters, member, torque, forces)
        _put(forces, drives.thrusters, out)


@called
def _read(measurements: Vector, which: Indices) -> Vector:
    found = np.empty(which.size)
    for k in range(which.size):
        found[k] = measurements[which[k]]
    return found


@called
def _put(efforts: Vector, joints: Indices, out: Vector) -> None:
    for k in range(joints.size):
        out[joints[k]] = efforts[k]


@called
def _remove_momentum(
    n: AllocationNumbers, member: int, speeds: Vector, torque: Vector, out: Vector
) -> None:
    """Write pushes against what the wheels store; take what they give off the torque."""
    stored, forces = np.zeros(3), np.empty(n.drives.thrusters.size)
    for k in range(speeds.size):
        spin = n.wheels.inertia[member, k] * speeds[k]
        for i in range(3):
            stored[i] -= n.unloading[member] * n.wheels.torque[member, i, k] * spin
    thruster_efforts(n.thrusters, member, stored, forces)
    _put(forces, n.drives.thrusters, out)
    for k in range(forces.size):
        for i in range(3):
            torque[i] -= n.torque[member, i, n.drives.thrusters[k]] * forces[k]
