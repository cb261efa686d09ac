"""The definitions of messages, read from the .msg files: their text and their fields."""

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from flexslew_plant.errors import BadInput

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

SEPARATOR = "=" * 80
_CODES = {
    "bool": "?", "byte": "B", "char": "B", "int8": "b", "uint8": "B", "int16": "h",
    "uint16": "H", "int32": "i", "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f",
    "float64": "d", "string": "s",
}  # fmt: skip


class Field(NamedTuple):
    """One member of a type."""

    name: str
    array: bool  # a sequence or an array
    fixed: int  # length of a fixed array, else 0
    code: str  # of a number in the terms of `struct`, "s" of a text, "" of a nested type
    nested: str  # the type's name where it is nested
    comment: str


@lru_cache
def message_directory(package: str) -> Path | None:
    """Return where the .msg files of a package lie, or None where no place has them.

    The ament index gives the place in an installed workspace; where there is none, the source tree
    next to this package has them, and an installation by pip holds a copy.
    """
    here = Path(__file__).resolve()
    places = [here.parents[2] / package, here.parent / "definitions" / package]
    try:
        from ament_index_python.packages import get_package_share_directory

        places.insert(0, Path(get_package_share_directory(package)))
    except (ImportError, LookupError, ValueError, OSError):  # no ROS, or not sourced
        pass
    return next((place / "msg" for place in places if (place / "msg").is_dir()), None)


@lru_cache
def standard_types() -> "Typestore":
    """Return the store of the common interfaces, which takes 0.2 s: without ROS, or for a log."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


@lru_cache
def definition(type_name: str) -> str:
    """Return the text of one .msg file as its authors wrote it, comments included.

    Args:
        type_name: `package/msg/Type`.

    Raises:
        BadInput: no definition of this type is known.
    """
    package, _, name = type_name.split("/")
    directory = message_directory(package)
    if directory is not None and (directory / f"{name}.msg").is_file():
        return (directory / f"{name}.msg").read_text(encoding="utf-8")
    if type_name not in standard_types().fielddefs:
        raise BadInput(f"no definition of {type_name} is known; build the workspace and source it")
    text, _ = standard_types().generate_msgdef(type_name, ros_version=2)
    return text.split(SEPARATOR)[0]


@lru_cache
def fields(type_name: str) -> tuple[Field, ...]:
    """Return the members of a type in their order in the message; constants are left out.

    Raises:
        BadInput: the type is not known.
    """
    package, found = type_name.split("/")[0], []
    for line in definition(type_name).splitlines():
        declared, _, comment = line.partition("#")
        words = declared.split()
        if len(words) < 2 or "=" in declared.replace("<=", ""):
            continue
        kind, bracket, length = words[0].partition("[")
        kind = kind.partition("<=")[0]
        fixed = int(length[:-1]) if length[:-1].isdigit() else 0
        *inner, name = kind.split("/")
        nested = "" if kind in _CODES else f"{inner[0] if inner else package}/msg/{name}"
        code = _CODES.get(kind, "")
        found.append(Field(words[1], bool(bracket), fixed, code, nested, comment.strip()))
    return tuple(found)


@lru_cache
def leaves(type_name: str) -> tuple[Field, ...]:
    """Return the members of a type with those of a nested type in its place.

    Raises:
        BadInput: one is a sequence of a nested type, which has no fixed number of members.
    """
    found: list[Field] = []
    for field in fields(type_name):
        if field.nested and field.array:
            raise BadInput(f"{field.name} is a sequence of {field.nested}", type_name)
        found += leaves(field.nested) if field.nested else (field,)
    return tuple(found)
