"""A torque shared out among the drives of craft side by side, as machine code."""

from collections.abc import Hashable, Sequence
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.allocation.gyro_set import NO_GYROS, GyroNumbers, gyro_efforts
from flexslew_control.allocation.thruster_set import (
    NO_THRUSTERS,
    ThrusterNumbers,
    thruster_pushes,
)
from flexslew_control.allocation.wheel_set import NO_WHEELS, WheelNumbers, wheel_efforts
from flexslew_plant.arrays import Indices, Tensor, Vector, called, compiled_once

NONE: Indices = np.zeros(0, dtype=np.int64)


class Drives(NamedTuple):
    """Which joints take part, and the readings of their states; the same in all lanes."""

    wheels: Indices = NONE
    speeds: Indices = NONE  # of the wheels, among the readings of the tips; none: not measured
    thrusters: Indices = NONE
    gyros: Indices = NONE
    angles: Indices = NONE  # of their gimbals, among the readings of the tips


class AllocationNumbers(NamedTuple):
    """The data of an Allocator for several spacecraft, a lane each."""

    drives: Drives
    torque: Tensor  # of a unit effort of each joint, (lanes, 3, joints)
    unloading: Vector  # (lanes,) [1/s]
    wheels: WheelNumbers = NO_WHEELS
    thrusters: ThrusterNumbers = NO_THRUSTERS
    gyros: GyroNumbers = NO_GYROS


def side_by_side(lanes: Sequence[Any]) -> Any:
    """Return numbers of one lane each as those of all lanes; whole numbers are the first's."""
    first = lanes[0]
    if isinstance(first, tuple):
        return type(first)(*map(side_by_side, zip(*lanes, strict=True)))
    return first if first.dtype == np.int64 else np.concatenate(lanes)


def kind_of(numbers: Any) -> Hashable:
    """Return what is equal for numbers that may stand side by side."""
    if isinstance(numbers, tuple):
        return tuple(map(kind_of, numbers))
    found: Hashable = numbers.tobytes() if numbers.dtype == np.int64 else numbers.shape
    return found


@compiled_once("out")
def share(
    n: AllocationNumbers, lane: int, torque: Vector, readings: Vector, time: float, out: Vector
) -> None:
    """Write the efforts of all joints that give a torque; see Allocator.efforts.

    Args:
        n: data of some lanes.
        lane: index of the lane.
        torque: about the centre of mass, in body axes, shape (3,) [N m].
        readings: tip readings; empty: none are known, and gimbals stand at zero.
        time: simulated time [s].
        out: shape (joints,) [N m or N].
    """
    drives, told = n.drives, readings.size > 0
    for i in range(out.size):
        out[i] = 0.0
    if drives.gyros.size:
        own = np.empty(drives.gyros.size)
        angles = _read(readings, drives.angles) if told else np.zeros(own.size)
        gyro_efforts(n.gyros, lane, torque, angles, time, own)
        _put(own, drives.gyros, out)
    elif drives.wheels.size:
        speeds = _read(readings, drives.speeds) if told else np.zeros(0)
        left, own = torque.copy(), np.empty(drives.wheels.size)
        if drives.thrusters.size and speeds.size:
            _unload(n, lane, speeds, left, out)
        wheel_efforts(n.wheels, lane, left, speeds, own)
        _put(own, drives.wheels, out)
    else:
        pushes = np.empty(drives.thrusters.size)
        thruster_pushes(n.thrusters, lane, torque, pushes)
        _put(pushes, drives.thrusters, out)


@called
def _read(readings: Vector, which: Indices) -> Vector:
    found = np.empty(which.size)
    for k in range(which.size):
        found[k] = readings[which[k]]
    return found


@called
def _put(efforts: Vector, joints: Indices, out: Vector) -> None:
    for k in range(joints.size):
        out[joints[k]] = efforts[k]


@called
def _unload(n: AllocationNumbers, lane: int, speeds: Vector, torque: Vector, out: Vector) -> None:
    """Write pushes against what the wheels store; take what they give off the torque."""
    stored, pushes = np.zeros(3), np.empty(n.drives.thrusters.size)
    for k in range(speeds.size):
        spin = n.wheels.inertia[lane, k] * speeds[k]
        for i in range(3):
            stored[i] -= n.unloading[lane] * n.wheels.torque[lane, i, k] * spin
    thruster_pushes(n.thrusters, lane, stored, pushes)
    _put(pushes, n.drives.thrusters, out)
    for k in range(pushes.size):
        for i in range(3):
            torque[i] -= n.torque[lane, i, n.drives.thrusters[k]] * pushes[k]
