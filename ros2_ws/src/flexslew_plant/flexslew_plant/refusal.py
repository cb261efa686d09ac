"""Why something was not done, one record for values, requests and readiness; and replies."""

import re
from dataclasses import dataclass, replace
from enum import Enum, StrEnum, auto
from typing import Any, Final, NamedTuple


class Cause(StrEnum):
    """What a program needs to know of a refusal; the words are for people."""

    NOT_ALLOWED = "not_allowed"  # a value
    PAST = "past"  # the tick is over
    RUN_OVER = "run_over"
    NOT_NOW = "not_now"  # the state of the run does not permit it
    FAULTS_OFF = "faults_off"
    UNKNOWN = "unknown"  # no node or thing of this name or number
    LATCHED = "latched"  # the brake
    NOT_LATCHED = "not_latched"
    ALREADY_DUE = "already_due"  # another switch at that tick
    ALREADY_IN_CHARGE = "already_in_charge"
    TOOK_OVER = "took_over"  # another controller, before this one had answered
    STEP_TOO_LARGE = "step_too_large"  # of the effort, under strict
    NO_ANSWER = "no_answer"  # in time, or at all
    BENCH_RESET = "bench_reset"
    NOT_READY = "not_ready"  # without a cause in this table
    NO_HEARTBEAT = "no_heartbeat"
    ABSENT = "absent"  # not on the graph
    BEHIND = "behind"  # it has not seen the newest ticks
    NO_TESTBED = "no_testbed"
    NO_PLAN = "no_plan"
    PLAN_MISMATCH = "plan_mismatch"  # joints, period or start of a plan
    LAW_FAILED = "law_failed"
    DOUBTED = "doubted"  # the estimate, by its innovations
    NOT_FINITE = "not_finite"
    NOT_HEARD = "not_heard"  # by the nodes that must receive it
    DUPLICATE = "duplicate"  # another node of this name is on the graph
    NO_MANOEUVRE = "no_manoeuvre"  # the planner found none
    CANCELED = "canceled"


class _NoValue(Enum):
    """The value of a refusal that is about none; an enum, for it goes from process to process."""

    NO_VALUE = auto()


NO_VALUE: Final = _NoValue.NO_VALUE
_MAX_VALUE_LENGTH = 60  # characters of a value
_WORD, _LINE = 300, 3000  # characters of a message


@dataclass(frozen=True)
class Refusal:
    """Why not, for a program and in one line for a person.

    Args:
        why: what is allowed, or why not and what to do; without the parts that follow.
        key: the value's place in its source, for example plan.duration.
        value: that is not allowed; left out where the refusal is about none.
        source: the file, node or option.
        cause: for programs.
    """

    why: str
    key: str = ""
    value: Any = NO_VALUE
    source: str = ""
    cause: Cause = Cause.NOT_ALLOWED

    def __str__(self) -> str:
        """Return `source: key: value is not allowed: why`, without the parts that there are not."""
        why = self.why
        if self.value is not NO_VALUE:
            why = f"{_value_text(self.value)} is not allowed: {why}"
        return one_line(": ".join(part for part in (self.source, self.key, why) if part))

    def within(self, key: str = "", source: str = "") -> "Refusal":
        """Return it as part of a larger input.

        Args:
            key: put in front of its own.
            source: in place of its own.
        """
        whole = ".".join(part for part in (key, self.key) if part)
        return replace(self, key=whole, source=source or self.source)


class Reply(NamedTuple):
    """What became of a request."""

    done: str = ""  # what was done or will be, for people
    refused: Refusal | None = None
    tick: int = 0  # at which it takes effect
    number: int = -1  # by which a fault or a disturbance can be ended; -1: there is none

    @property
    def ok(self) -> bool:
        """It was granted."""
        return self.refused is None

    @property
    def message(self) -> str:
        """What was done or why not, for people."""
        return str(self.refused or self.done)


NO_TESTBED = Refusal("no testbed announced yet", cause=Cause.NO_TESTBED)


def one_line(text: str) -> str:
    """Return a text in which what would break its line, or does not show, is escaped.

    Words of more than 300 characters and a line of more than 3,000 are shortened in their middle.
    """
    if len(text) > _WORD:
        text = _truncate(re.sub(rf"\S{{{_WORD},}}", lambda word: _truncate(word[0], _WORD), text))
    return text if text.isprintable() else _truncate("".join(map(_escaped, text)))


def _truncate(text: str, max_length: int = _LINE) -> str:
    """Return a text of at most this many characters, with how many are left out of its middle."""
    left_out = len(text) - max_length
    if left_out <= 0:
        return text
    return f"{text[: max_length // 2]}...({left_out:,} characters)...{text[-(max_length // 3) :]}"


def _escaped(letter: str) -> str:
    return letter if letter.isprintable() else ascii(letter)[1:-1]


def _value_text(value: Any) -> str:
    """Return a value as Python writes it, at most 60 characters of it."""
    if isinstance(value, str | bytes):
        value = value[: _MAX_VALUE_LENGTH + 1]
    text = repr(value.tolist() if hasattr(value, "tolist") else value)
    return text if len(text) <= _MAX_VALUE_LENGTH else f"{text[: _MAX_VALUE_LENGTH - 3]}..."
