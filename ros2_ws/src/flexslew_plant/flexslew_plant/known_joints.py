"""Mappings by joint: every name in them is one of a joint."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Annotated, Any, Final, TypeAlias, TypeVar, get_args

from pydantic.dataclasses import is_pydantic_dataclass

from flexslew_plant.errors import BadInput
from flexslew_plant.near_names import spelling_hint

_T = TypeVar("_T")


class _ByJoint:
    """Marks the type of a mapping with joint names as keys."""


_BY_JOINT: Final = _ByJoint()
ByJoint: TypeAlias = Annotated[dict[str, _T], _BY_JOINT]
_ALWAYS = ("goal", "initial")  # keys of a plan that are by joint in a user's own section, too


def unknown_joint(name: str, joints: Sequence[str]) -> str:
    """Return why a name is refused, with the names that are allowed."""
    hint = spelling_hint(name, joints)
    return f"{name} is not a joint of the testbed; {hint}allowed: {', '.join(joints)}"


def require_joints(
    given: Iterable[str], joints: Sequence[str], key: str = "", source: str = ""
) -> None:
    """Check that names are those of joints.

    Args:
        given: names, for example the keys of a mapping.
        joints: of the testbed.
        key: of the mapping, for the error.
        source: the file to name in the error.

    Raises:
        BadInput: the first name that is not.
    """
    for name in given:
        if name not in joints:
            raise BadInput(unknown_joint(name, joints), source, key)


def require_joints_of(
    settings: Any, joints: Sequence[str], key: str = "", source: str = ""
) -> None:
    """Check every mapping by joint of a section, and of the sections in it.

    Args:
        settings: an instance of a section.
        joints: of the testbed.
        key: of the section, for the error.
        source: the file to name in the error.

    Raises:
        BadInput: the first name that is not one of a joint.
    """
    for path, mapping in _mappings(settings, False, (key,)):
        require_joints(mapping, joints, ".".join(filter(None, path)), source)


def _mappings(
    value: Any, is_by_joint: bool, path: tuple[str, ...]
) -> Iterator[tuple[tuple[str, ...], dict[str, Any]]]:
    """Yield the mappings by joint, and where they stand."""
    if is_pydantic_dataclass(type(value)):
        for name, field in type(value).__pydantic_fields__.items():
            by_joint = _BY_JOINT in field.metadata or _is_by_joint(field.annotation)
            by_joint |= name in _ALWAYS and len(path) == 1
            yield from _mappings(getattr(value, name), by_joint, (*path, name))
    elif isinstance(value, dict) and is_by_joint:
        yield path, value
    elif isinstance(value, dict | list | tuple):
        for key, part in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _mappings(part, is_by_joint, (*path, str(key)))


def _is_by_joint(kind: Any) -> bool:
    """Return whether a type, or one of those that it joins, is marked."""
    marks = getattr(kind, "__metadata__", ())
    return _BY_JOINT in marks or any(_is_by_joint(part) for part in get_args(kind))
