"""An event as a log or a topic carries it, checked: a bag may be crafted."""

from typing import Any

from flexslew_lab.log.messages.logged_text import logged_json, logged_yaml
from flexslew_lab.log.messages.older import completed
from flexslew_plant.errors import BadInput
from flexslew_plant.events import Event, InjectionRequested, Level, TargetRequested, fact_of
from flexslew_plant.refusal import Refusal

_LEVELS = list(Level)


def logged_event(message: Any, source: str) -> Event:
    """Return a decoded flexslew_msgs/Event, checked.

    Args:
        message: with the fields of the type as attributes.
        source: the log, for the error.

    Raises:
        BadInput: its data is not what an event of its kind holds, or its level is none.
    """
    where = f"{source}: event {message.kind!r:.40} at tick {message.tick}"
    data = completed(message.kind, message.tick, logged_json(message.data, f"{where}: data"))
    try:
        what = fact_of(message.kind, data)
    except BadInput as error:
        raise BadInput(error.refusal.within("data", where)) from None
    if isinstance(what, InjectionRequested | TargetRequested):
        logged_yaml(what.text, f"{where}: data: text")
    if message.level >= len(_LEVELS):
        allowed = ", ".join(f"{level.number} ({level})" for level in Level)
        raise BadInput(Refusal(allowed, "level", message.level, where))
    at = message.stamp.sec + message.stamp.nanosec * 1e-9
    level = _LEVELS[message.level]
    return Event(message.tick, at, message.epoch, level, message.source, what, message.message)
