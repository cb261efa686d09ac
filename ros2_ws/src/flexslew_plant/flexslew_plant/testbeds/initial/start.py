"""Where a testbed begins: its joints, and its whole state."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeGuard, TypeVar

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.known_joints import require_joints
from flexslew_plant.testbeds.contract import StartsMoving, Testbed
from flexslew_plant.testbeds.initial.initial_motion import KEY, InitialMotion, moving_state
from flexslew_plant.testbeds.initial.many import implements
from flexslew_plant.testbeds.model import Model

_Testbed = TypeVar("_Testbed", bound=Any)
_SAME = 1e-9  # largest difference of a joint's reading from its position [rad or m]


def initial_positions(testbed: Testbed) -> dict[str, float]:
    """Return where each joint rests at the start, by name [rad or m].

    One that `initial` leaves out may read where the others put it.

    Raises:
        BadInput: a name is not one of a joint, or no attitude has those that it names.
    """
    return _initial_positions(testbed, testbed.model())


def _initial_positions(testbed: Testbed, model: Model) -> dict[str, float]:
    given = testbed.initial
    values = given if isinstance(given, dict) else vars(given)
    names = model.joint_names
    if isinstance(given, dict):
        require_joints(given, names, "initial")
    first = {name: float(values.get(name, 0.0)) for name in names}
    if not any(first.values()):
        return first
    if model.attitude is not None:
        first = consistent_positions(model, first, [n for n in names if n in values], "initial")
    if set(names) <= set(values):
        return first
    read, _ = model.joint_state(np.concatenate((model.rest(first), np.zeros(model.coordinates))))
    off = abs(model.joint_error(read, np.array([*first.values()]))) > _SAME
    return {
        name: float(at) if other else first[name]
        for name, at, other in zip(names, read, off, strict=True)
    }


def consistent_positions(
    model: Model,
    requested: Mapping[str, float],
    named: Collection[str],
    key: str,
    first: Mapping[str, float] | None = None,
) -> dict[str, float]:
    """Return positions by joint that one attitude has; see AttitudeJoints.together.

    Args:
        model: model with these joints.
        requested: position of each joint [rad or m].
        named: names of the joints that are given.
        key: key that gives them, for an error.
        first: present position of each joint [rad or m]; None: at zero.

    Raises:
        BadInput: no attitude has the named ones.
    """
    if model.attitude is None:
        return dict(requested)
    names = model.joint_names
    begin, end = (
        np.array([at.get(name, 0.0) for name in names]) for at in (first or {}, requested)
    )
    try:
        found = model.attitude.together(end, np.array([name in named for name in names]), begin)
    except BadInput as error:
        given = {name: requested[name] for name in names if name in named}
        raise BadInput(error.refusal.why, key=key, value=given) from None
    return dict(zip(names, found.tolist(), strict=True))


def initial_state(testbed: Testbed) -> Vector:
    """Return [q, v] at the start: at rest, appendages straight, unless the testbed moves.

    Raises:
        BadInput: `initial` or `initial_motion` has what the testbed does not have.
    """
    return _initial_state(testbed, testbed.model())


def initial_states(testbeds: Sequence[Testbed], models: Sequence[Model]) -> Matrix:
    """Return [q, v] of many testbeds of one kind at the start, a row each; see initial_state."""
    found = list[Vector]()
    known: Any = None
    for testbed, model in zip(testbeds, models, strict=True):
        numbers = _rest_of_numbers(testbed, model)
        found.append(
            found[-1]
            if numbers is not None and numbers == known
            else _initial_state(testbed, model)
        )
        known = numbers
    return np.array(found)


def _initial_state(testbed: Testbed, model: Model) -> Vector:
    rest = model.rest(_initial_positions(testbed, model))
    v = testbed.initial_rates() if _has_rate_method(testbed) else np.zeros(model.coordinates)
    motion = initial_motion(testbed)
    return np.concatenate((rest, v)) if motion is None else moving_state(motion, model, rest, v)


def _rest_of_numbers(testbed: Testbed, model: Model) -> Any:
    """Return all that a testbed's state at the start depends on; None: more than `initial`."""
    reads = (model.rest_position, model.reading, model.attitude) != (None, None, None)
    if reads or _has_rate_method(testbed) or initial_motion(testbed) is not None:
        return None
    return testbed.initial, model.joint_names, model.positions, model.coordinates


def starts_in_motion(testbed: Testbed) -> bool:
    """Return whether a testbed has rates or deflections at the start."""
    if initial_motion(testbed) is not None:
        model = testbed.model()
        q, v = model.split(_initial_state(testbed, model))
        speeds = np.delete(v, list(model.gimbals))  # whose entries of v are angles
        return bool(speeds.any() or q[model.positions - model.modes :].any())
    return _has_rate_method(testbed) and bool(testbed.initial_rates().any())


def at_rest(testbed: _Testbed) -> _Testbed:
    """Return a testbed without `initial_motion`."""
    return testbed if initial_motion(testbed) is None else replace(testbed, initial_motion=None)


def initial_motion(testbed: Testbed) -> InitialMotion | None:
    """Return the section `initial_motion`; None: it has none."""
    return getattr(testbed, KEY, None)


def _has_rate_method(testbed: Any) -> TypeGuard[StartsMoving]:
    kind: Any = type(testbed)
    return implements(kind, StartsMoving)
