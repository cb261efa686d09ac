"""Message definitions without ROS: their text, their type hashes, and a store of them."""

from functools import lru_cache
from pathlib import Path

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.base import TypesysError
from rosbags.typesys.store import Typestore

from flexslew_plant.errors import BadInput

MESSAGES = "flexslew_msgs"
SEPARATOR = "=" * 80
_PRIMITIVES = frozenset(
    {
        *("bool", "byte", "char", "float32", "float64", "string", "wstring"),
        *("int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64"),
    }
)


@lru_cache
def message_directory(package: str) -> Path | None:
    """Return where the .msg files of a package lie, or None where no place has them.

    The ament index gives the place in an installed workspace; where there is none, the source tree
    next to this package has them, and an installation by pip holds a copy.
    """
    here = Path(__file__).resolve()
    places = [here.parents[4] / package, here.parents[2] / "definitions" / package]
    try:
        from ament_index_python.packages import get_package_share_directory

        places.insert(0, Path(get_package_share_directory(package)))
    except (ImportError, LookupError, ValueError, OSError):  # no ROS, or not sourced
        pass
    return next((place / "msg" for place in places if (place / "msg").is_dir()), None)


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
    try:
        text, _ = _standard().generate_msgdef(type_name, ros_version=2)
    except TypesysError:
        raise BadInput(
            f"no definition of {type_name} is known; build the workspace and source it"
        ) from None
    return text.split(SEPARATOR)[0]


@lru_cache
def schema_text(type_name: str) -> str:
    """Return the ros2msg schema: the definition, then every nested one behind a separator.

    Args:
        type_name: `package/msg/Type`.

    """
    parts = [definition(type_name)]
    for nested in _nested(type_name):
        package, _, name = nested.split("/")
        parts.append(f"MSG: {package}/{name}\n{definition(nested)}")
    return f"\n{SEPARATOR}\n".join(part.rstrip("\n") for part in parts) + "\n"


@lru_cache
def type_hash(type_name: str) -> str:
    """Return the RIHS01 hash that ROS 2 gives to the type."""
    return store().hash_rihs01(type_name)


@lru_cache(maxsize=32)  # every bag has the same dozen
def hash_of_schema(type_name: str, text: str) -> str:
    """Return the RIHS01 hash of a type as a ros2msg schema (of a bag) describes it.

    Raises:
        BadInput: the text is no message definition.

    """
    try:
        recorded_types = get_typestore(Stores.EMPTY)
        recorded_types.register(get_types_from_msg(text, type_name))
        return recorded_types.hash_rihs01(type_name)
    except Exception as error:  # a parser fed with anything at all
        raise BadInput(f"the schema of {type_name} is not a message definition: {error}") from None


@lru_cache
def store() -> Typestore:
    """Return the store of all types that a bag of this project may hold."""
    return _with_project_types(_standard())


@lru_cache
def default_store() -> Typestore:
    """Return the store for bags without definitions, of Foxy to Humble."""
    return _with_project_types(get_typestore(Stores.ROS2_HUMBLE))


def _with_project_types(known: Typestore) -> Typestore:
    """Return a store after adding the messages of this project."""
    directory = message_directory(MESSAGES)
    if directory is None:
        raise BadInput(f"the definitions of {MESSAGES} are not found; build the workspace")
    for path in sorted(directory.glob("*.msg")):
        name = f"{MESSAGES}/msg/{path.stem}"
        known.register(get_types_from_msg(path.read_text(encoding="utf-8"), name))
    return known


@lru_cache
def _standard() -> Typestore:
    """Return the store with the common interfaces; `store` adds this project's to it."""
    return get_typestore(Stores.ROS2_JAZZY)


def field_types(text: str) -> list[tuple[str, str, str]]:
    """Return (type, name, comment) of the fields of one .msg text, constants left out."""
    fields = []
    for line in text.splitlines():
        code, _, comment = line.partition("#")
        words = code.split()
        if len(words) >= 2 and "=" not in code.replace("<=", ""):
            fields.append((words[0], words[1], comment.strip()))
    return fields


def _nested(type_name: str) -> list[str]:
    """Return the types inside type_name, each once, in the order of their first use."""
    order: list[str] = []

    def visit(name: str) -> None:
        package = name.split("/")[0]
        for kind, _, _ in field_types(definition(name)):
            base = kind.split("[")[0].split("<=")[0]
            if base in _PRIMITIVES:
                continue
            parts = base.split("/")
            inner = f"{parts[0] if len(parts) > 1 else package}/msg/{parts[-1]}"
            if inner not in order:
                order.append(inner)
                visit(inner)

    visit(type_name)
    return order
