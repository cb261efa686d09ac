"""Goals of a craft that turns in three axes: an attitude instead of positions of joints."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from pydantic import Discriminator, Field, Tag
from scipy.spatial.transform import Rotation

from flexslew_control.law import PlantDescription
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.known_joints import ByJoint
from flexslew_plant.settings import section
from flexslew_plant.testbeds import initial_positions
from flexslew_plant.testbeds.orientation.attitude import product, quaternion, rotation_vector

Triple: TypeAlias = tuple[float, float, float]
Order: TypeAlias = Literal[
    "xyz", "xzy", "yxz", "yzx", "zxy", "zyx", "xyx", "xzx", "yxy", "yzy", "zxz", "zyz"
]
_ROUNDING = 1e-12  # of a goal that is the start [rad]
SAME = 1e-9  # angle below which there is nothing to turn [rad]


@section
class AttitudeGoal:
    """An attitude, in one of four ways.

    It turns inertial axes into body axes; unless `relative`, from the attitude zero of the joints.
    """

    quaternion: tuple[float, float, float, float] | None = None  # x y z w, of any length
    axis: Triple | None = None  # axis of a turn by `angle`, of any length
    angle: float | None = None  # of that turn [rad]
    euler: Triple | None = None  # three angles about the body's axes, one after another [rad]
    order: Order | None = None  # of these axes, as zyx or zxz
    # inertial direction to which `boresight` turns, by the least angle
    to: Triple | None = None
    boresight: Triple = (0.0, 0.0, 1.0)  # direction in body axes, with `to`
    # a turn from where the craft starts, not from the attitude zero of the joints
    relative: bool = False

    def __post_init__(self) -> None:
        """Refuse none of the four, more than one, or half of one.

        Raises:
            ValueError: in words for the section's reader.
        """
        options: dict[str, list[Any]] = {
            "quaternion": [self.quaternion],
            "axis and angle": [self.axis, self.angle],
            "euler and order": [self.euler, self.order],
            "to": [self.to],
        }
        started = [name for name, parts in options.items() if any(p is not None for p in parts)]
        if len(started) != 1 or any(part is None for part in options[started[0]]):
            raise ValueError(f"give one of {', '.join(options)}")
        for name in ("quaternion", "axis", "to", "boresight"):
            given = getattr(self, name)
            if given is not None and not np.linalg.norm(given) > 0.0:
                raise ValueError(f"{name} must not be zero")

    def attitude(self, start: Vector) -> Vector:
        """Return the requested quaternion x y z w, shape (4,).

        Args:
            start: quaternion of the spacecraft at the start, shape (4,).
        """
        if self.to is not None:
            return product(start, self._least(start, np.array(self.to)))
        if self.quaternion is not None:
            requested = np.array(self.quaternion) / np.linalg.norm(self.quaternion)
        elif self.axis is not None and self.angle is not None:
            axis = np.array(self.axis) / np.linalg.norm(self.axis)
            requested = quaternion(self.angle * axis)
        else:
            assert self.order is not None
            assert self.euler is not None
            requested = Rotation.from_euler(self.order.upper(), self.euler).as_quat()
        return product(start, requested) if self.relative else requested

    def _least(self, start: Vector, to: Vector) -> Vector:
        """Return the least turn in body axes that points the boresight, as a quaternion."""
        boresight = np.array(self.boresight) / np.linalg.norm(self.boresight)
        target = Rotation.from_quat(start).inv().apply(to / np.linalg.norm(to))
        cross = np.cross(boresight, target)
        if np.linalg.norm(cross) < SAME and boresight @ target < 0.0:  # any axis across it will do
            cross = np.cross(boresight, np.eye(3)[int(np.argmin(abs(boresight)))])
            return quaternion(np.pi * cross / np.linalg.norm(cross))
        half = np.append(cross, 1.0 + boresight @ target)
        return np.asarray(half / np.linalg.norm(half))


_KEYS = frozenset(field.name for field in fields(AttitudeGoal))


def _way(goal: Any) -> str:
    """Return whether a goal is an attitude or positions of joints."""
    attitude = isinstance(goal, AttitudeGoal) or (isinstance(goal, Mapping) and _is_attitude(goal))
    return "attitude" if attitude else "joints"


def _is_attitude(goal: Mapping[Any, Any]) -> bool:
    return any(isinstance(key, str) and key in _KEYS - {"relative", "boresight"} for key in goal)


Goal = Annotated[
    Annotated[ByJoint[float], Tag("joints")] | Annotated[AttitudeGoal, Tag("attitude")],
    Discriminator(_way),
]
GoalKey = Annotated[
    Goal | None,
    Field(
        description="joint positions at the end, at rest, by name, one left out stays [rad or m]; "
        "or an attitude; null: a typical slew of the testbed"
    ),
]


def joint_goal(
    goal: AttitudeGoal, plant: PlantDescription, initial: dict[str, float] | None
) -> dict[str, float]:
    """Return the joint positions at which the craft has the attitude, by name [rad].

    The rotation vectors of one attitude differ by whole turns; the one next to the start's is used.

    Args:
        goal: the requested attitude.
        plant: the bench.
        initial: joint positions at the start that replace those of the testbed.

    Raises:
        BadInput: if the joints do not read an attitude in three axes.
    """
    model = plant.testbed.model()
    if model.attitude is None:
        raise BadInput(
            f"the joints, {', '.join(model.joint_names)}, do not read an attitude in three axes; "
            "give positions by joint",
            "plan",
            "goal",
        )
    named = initial_positions(plant.testbed) | (initial or {})
    first = np.array([named[name] for name in model.joint_names])
    start = model.attitude.rotation_vector_of(first)
    rotation = nearest_rotation(rotation_vector(goal.attitude(quaternion(start))), start)
    last = model.attitude.axes @ rotation
    last = np.where(abs(last - first) <= _ROUNDING, first, last)
    return {
        name: float(at)
        for name, at, axis in zip(model.joint_names, last, model.attitude.axes, strict=True)
        if axis.any()
    }


def nearest_rotation(rotation: Vector, to: Vector) -> Vector:
    """Return the rotation vector of the same attitude that is next to another one [rad]."""
    angle = float(np.linalg.norm(rotation))
    if angle > SAME:
        axis = rotation / angle
    elif np.linalg.norm(to) > np.pi:
        axis, angle = to / np.linalg.norm(to), 0.0
    else:
        return rotation
    angle_count = np.round((axis @ to - angle) / (2.0 * np.pi))
    return rotation if angle_count == 0.0 else (angle + 2.0 * np.pi * angle_count) * axis
