"""Events: what took effect at a tick, the same in process, on the topic and in a log."""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from functools import cache
from typing import Annotated, Any, ClassVar, NamedTuple, Protocol, TypeVar, dataclass_transform

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

from flexslew_plant.errors import BadInput
from flexslew_plant.refusal import Refusal

JOINTS = 64  # at most, on any testbed
MAX_TEXT = 1 << 16  # of a field [characters]
_MAX_NAME = 200  # of an operator [characters]

Count = Annotated[int, Field(ge=0, lt=1 << 63, strict=True)]
Finite = Annotated[float, Field(allow_inf_nan=False, strict=True)]
Seconds = Annotated[float, Field(ge=0.0, le=1e12, strict=True)]
Text = Annotated[str, Field(max_length=MAX_TEXT, strict=True)]
Flag = Annotated[bool, Field(strict=True)]
Efforts = Annotated[list[Finite], Field(max_length=JOINTS)]  # one per joint [N m or N]

_T = TypeVar("_T")
NO_NAME = "unnamed"  # an operator that gives no name


def too_long(text: str) -> str:
    """Return why a text is too long for a field of an event; empty: it is not."""
    if len(text) <= MAX_TEXT:
        return ""
    return f"has {len(text):,} characters; at most {MAX_TEXT:,} are allowed"


def _key(name: str) -> str:
    return name.rstrip("_")


class Level(StrEnum):
    """How bad it is."""

    INFO = "info"
    WARNING = "warning"
    FAULT = "fault"

    @property
    def number(self) -> int:
        """That of flexslew_msgs/Event."""
        return list(Level).index(self)


class Fact(Protocol):
    """The record of an event: a frozen dataclass per kind; its fields are the keys of its data.

    A field with a word of Python as its key ends in an underscore: from_ is `from`. A field that
    is None is left out.
    """

    __dataclass_fields__: ClassVar[dict[str, Any]]


class Kind(NamedTuple):
    """What all events of a kind share."""

    name: str  # on the topic and in the log
    level: Level | Callable[[Any], Level]  # of all, or of a record
    message: str | Callable[[Any], str]  # one line: a format of the fields, or of a record


KINDS: dict[type[Any], Kind] = {}


@dataclass_transform(frozen_default=True)
def fact(
    kind: str, level: Level | Callable[[Any], Level], message: str | Callable[[Any], str]
) -> Callable[[type[_T]], type[_T]]:
    """Return a decorator that makes a class the record of a kind of event.

    The class becomes a frozen dataclass against which the data of a log can be checked.

    Args:
        kind: name on the topic and in the log.
        level: of all events of the kind, or a function of the record.
        message: one line for a person: a format of the fields, or a function of the record.
    """

    def register(cls: type[_T]) -> type[_T]:
        cls.__pydantic_config__ = ConfigDict(alias_generator=_key, extra="ignore")  # type: ignore[attr-defined]
        record = dataclass(frozen=True)(cls)
        KINDS[record] = Kind(kind, level, message)
        return record

    return register


def kinds() -> dict[str, type[Any]]:
    """Return the record class of every kind that was defined so far, by its name."""
    return {kind.name: record for record, kind in KINDS.items()}


def kind_of(what: Fact | type[Fact]) -> str:
    """Return the name of a kind of event, of its record or its class."""
    if isinstance(what, Other):
        return what.name
    return KINDS[what if isinstance(what, type) else type(what)].name


def level_of(what: Fact) -> Level:
    """Return how bad an event is; INFO for a kind of another version."""
    if isinstance(what, Other):
        return Level.INFO
    level = KINDS[type(what)].level
    return level if isinstance(level, Level) else level(what)


def message_of(what: Fact) -> str:
    """Return an event as one line for a person; the kind alone for one of another version."""
    if isinstance(what, Other):
        return what.name
    message = KINDS[type(what)].message
    return message.format_map(vars(what)) if isinstance(message, str) else message(what)


class Event(NamedTuple):
    """A fact with the place and the moment at which it took effect."""

    tick: int
    time: float  # simulated [s]
    epoch: int
    level: Level
    source: str  # the node
    what: Fact
    message: str  # one line for a person; of a log: in the words of that day

    @property
    def kind(self) -> str:
        """The name of the fact on the topic and in the log."""
        return kind_of(self.what)

    @property
    def data(self) -> dict[str, Any]:
        """The fact as plain data."""
        return data_of(self.what)

    def plain(self) -> dict[str, Any]:
        """Return it ready for JSON."""
        return {
            "time": self.time,
            "tick": self.tick,
            "epoch": self.epoch,
            "level": str(self.level),
            "source": self.source,
            "kind": self.kind,
            "message": self.message,
            "data": self.data,
        }


@dataclass(frozen=True)
class Other:
    """An event of a kind that this version does not define, of a newer log or a foreign node."""

    name: str  # of the kind
    content: dict[str, Any]


def is_reported(count: int) -> bool:
    """Return whether the event of this number, of many alike, is one to show to people.

    The 1st, 2nd, 4th, 8th, ...: a flood stays readable, and fills no pipe.
    """
    return count & (count - 1) == 0


def event_of(what: Fact, tick: int, time: float, epoch: int, source: str) -> Event:
    """Return a fact as the event of a tick; texts that no log could hold are cut.

    Args:
        what: the fact that has happened.
        tick: tick at which it takes effect.
        time: time of the tick [simulated s].
        epoch: number of resets so far.
        source: name of the node that reports it.
    """
    what = _short(what)
    return Event(tick, time, epoch, level_of(what), source, what, message_of(what))


def _short(what: Fact) -> Fact:
    """Return a fact with its texts cut to the most characters that are read back."""
    strings = {f.name: v for f in fields(what) if isinstance(v := getattr(what, f.name), str)}
    most = {name: _MAX_NAME if name == "who" else MAX_TEXT for name in strings}
    cut = {name: v[: most[name]] for name, v in strings.items() if len(v) > most[name]}
    return replace(what, **cut) if cut else what


def data_of(what: Fact) -> dict[str, Any]:
    """Return a fact as plain data by the keys that stand in a log."""
    content = getattr(what, "content", None)
    if content is not None:
        return dict(content)
    found = {_key(item.name): getattr(what, item.name) for item in fields(what)}
    return {key: value for key, value in found.items() if value is not None}


def checked(kind: type[Fact], data: dict[str, Any]) -> Fact:
    """Return data as a fact of this kind; keys that it does not know are left out.

    Raises:
        BadInput: a key is missing or its value is none that the kind can have.
    """
    try:
        return _adapter(kind).validate_python(data)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"]))
        raise BadInput(Refusal(first["msg"], key, first["input"])) from None


@cache
def _adapter(kind: type[Fact]) -> TypeAdapter[Fact]:
    return TypeAdapter(kind)
