"""The gains of a law that its C code keeps as parameters."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.controllers.controller import Controller
from flexslew_lab.export.c_code.printer import Signal

# units by the names that laws and their settings give them: of one for each joint, and of numbers
_UNITS = {
    "kp": "N m/rad or N/m",
    "ki": "N m/(rad s) or N/(m s)",
    "kd": "N m s/rad or N s/m",
}
_NUMBERS = {"reaching_rate": "1/s", "attitude_gain": "1/s"}
_DEPTH = 3  # of objects in a law
_AXES = ("x", "y", "z")


class Gain(NamedTuple):
    """A gain, as an attribute of an object of the law, and as a parameter."""

    owner: Any
    shape: tuple[int, ...]
    signal: Signal


def gains_of(controller: Controller) -> tuple[Gain, ...]:
    """Return the gains of a controller's law, which it reads at every tick.

    kp, ki and kd are one for each joint, of an allocated law one for each body axis, or rows of a
    matrix; others are numbers.
    """
    allocated = getattr(controller.law, "allocator", None) is not None
    names = _AXES if allocated else controller.joint_names
    owners = list(_objects(controller.law, _DEPTH))
    found = (_gain(owners, name, names) for name in (*_UNITS, *_NUMBERS))
    return tuple(gain for gain in found if gain is not None)


def _gain(owners: list[Any], name: str, joints: tuple[str, ...]) -> Gain | None:
    """Return the gain of a name that the first of some objects has; None: none has it."""
    for owner in owners:
        value = getattr(owner, name, None)
        if name in _NUMBERS and isinstance(value, float):
            return Gain(owner, (), Signal(name, _NUMBERS[name], 1, (value,)))
        if isinstance(value, np.ndarray) and len(value) == len(joints):
            labels = joints
            if value.ndim == 2:
                labels = tuple(f"{one}[{k + 1}]" for one in joints for k in range(value.shape[1]))
            numbers = tuple(value.ravel().tolist())
            return Gain(owner, value.shape, Signal(name, _UNITS[name], value.size, numbers, labels))
    return None


def _objects(value: Any, depth: int) -> Iterator[Any]:
    """Yield an object of the controllers and all of them that it holds."""
    if depth and type(value).__module__.startswith("flexslew_control."):
        yield value
        for part in getattr(value, "__dict__", {}).values():
            yield from _objects(part, depth - 1)
