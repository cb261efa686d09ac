"""Schemas and type hashes of messages without ROS, and a store of their types."""

from functools import lru_cache

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from flexslew_plant.errors import BadInput
from flexslew_plant.message_types import (
    SEPARATOR,
    definition,
    fields,
    message_directory,
    standard_types,
)

MESSAGES = "flexslew_msgs"


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
    return _with_project_types(standard_types())


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


def _nested(type_name: str) -> dict[str, None]:
    """Return the types inside type_name, each once, in the order of their first use."""
    found: dict[str, None] = {}
    for field in fields(type_name):
        if field.nested:
            found |= {field.nested: None, **_nested(field.nested)}
    return found
