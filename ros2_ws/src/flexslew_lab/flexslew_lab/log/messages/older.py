"""Messages and events of an older version as those of this one.

Fields that are newer than a message are empty. Older events give the reason of a dropped switch
as text only: this file, and no other, contains these texts.
"""

from collections.abc import Callable
from dataclasses import fields
from functools import lru_cache
from typing import Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from flexslew_lab.log.messages import cdr
from flexslew_lab.log.messages.schemas import store
from flexslew_plant.errors import BadInput
from flexslew_plant.events import EVENTS, SwitchDropped, kind_of
from flexslew_plant.refusal import Cause

_DROPPED = {  # part of a reason's text, from before events had a cause
    " is not ready": Cause.NOT_READY,
    "the brake is latched": Cause.LATCHED,
    " is already in charge": Cause.ALREADY_IN_CHARGE,
    " took over before it answered": Cause.TOOK_OVER,
    "the bench was reset": Cause.BENCH_RESET,
    "the run is over": Cause.RUN_OVER,
}


def completed(kind: str, tick: int, data: dict[str, Any]) -> dict[str, Any]:
    """Return the data of an event with the fields that later versions add.

    Args:
        kind: kind of the event.
        tick: tick of the event.
        data: data of the event in the log.
    """
    if kind == kind_of(SwitchDropped) and "cause" not in data:
        reason = str(data.get("reason", ""))
        cause = next((c for words, c in _DROPPED.items() if words in reason), Cause.NOT_ALLOWED)
        data = {**data, "cause": cause}
    has_tick = kind in EVENTS and any(item.name == "tick" for item in fields(EVENTS[kind]))
    return {"tick": int(tick), **data} if has_tick else data


@lru_cache(maxsize=32)
def upgrade(type_name: str, text: str) -> Callable[[bytes], bytes] | None:
    """Return what turns CDR bytes of an older definition into those of this version's.

    Args:
        type_name: `package/msg/Type`.
        text: the ros2msg schema of the older definition, one that hash_of_schema has read.

    Returns:
        None where it is no older one: a field is not known here, or is of another type.
    """
    old_types = get_typestore(Stores.EMPTY)
    old_types.register(get_types_from_msg(text, type_name))
    if not _part_of(type_name, old_types, store()):
        return None

    def upgraded(data: bytes) -> bytes:
        try:
            message = old_types.deserialize_cdr(data, type_name)
        except Exception as error:  # corrupt bytes meet generated code
            raise BadInput(f"{len(data)} bytes are not a {type_name}: {error}") from None
        return cdr.encode(type_name, message)

    return upgraded


def _part_of(type_name: str, old_types: Typestore, current_types: Typestore) -> bool:
    """Return whether all fields of an older definition, nested ones too, are fields here."""
    known = dict(current_types.fielddefs[type_name][1])
    if any(known.get(name) != kind for name, kind in old_types.fielddefs[type_name][1]):
        return False
    nested = set(old_types.fielddefs) - {type_name}
    return all(
        name in current_types.fielddefs
        and old_types.hash_rihs01(name) == current_types.hash_rihs01(name)
        for name in nested
    )
