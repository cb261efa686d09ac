"""What passes between the plant and a controller at one tick."""

from typing import NamedTuple

from flexslew_plant.arrays import Vector


class Measurement(NamedTuple):
    """The question of tick k: the sensor readings, and the controller that must answer."""

    tick: int  # k
    epoch: int  # counts resets; an answer to another epoch is stale
    time: float  # simulated, k times the period [s]
    controller: str  # that must answer
    joint_position: Vector  # encoders, (joints,) [rad or m]
    joint_velocity: Vector  # rate sensors, (joints,) [rad/s or m/s]
    tip_deflection: Vector  # (appendages,) [m]
    root_curvature: Vector  # at the clamped ends, (appendages,) [1/m]; half thickness * it = strain
    applied_effort: Vector  # held during the last tick, (joints,) [N m or N]

    def mismatch(self, joints: int, appendages: int) -> str:
        """Return which field has not one number per joint, or per appendage; empty: none."""
        *_, position, velocity, tip, curvature, applied = self  # every tick: the quickest way
        if len(position) == len(velocity) == len(applied) == joints and (
            len(tip) == len(curvature) == appendages
        ):
            return ""
        found = tuple(map(len, self[4:]))
        sizes = joints, joints, appendages, appendages, joints
        name, has, size = next(
            each for each in zip(_VECTORS, found, sizes, strict=True) if each[1] != each[2]
        )
        return f"{name}: {has} numbers where {size} belong"


_VECTORS = Measurement._fields[4:]


class EffortCommand(NamedTuple):
    """The answer: the effort to hold from tick k to k + 1."""

    tick: int
    epoch: int
    controller: str
    effort: Vector  # (joints,) [N m or N]
    instance: int = 0  # of the process that answers, as in its sign of life; 0: not given
