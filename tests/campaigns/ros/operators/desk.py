"""Where an operator sits: what is drawn, what is asked, and the diary of it."""

from collections.abc import Callable, Mapping, Sequence
from time import monotonic
from typing import Any, NamedTuple, TypeVar

import numpy as np
from flexslew_msgs import srv
from std_srvs.srv import Trigger

from flexslew_plant.graph import topics

from .bench import OperatedBench

WHO = "ann"
Acts = Mapping[Callable[[], str], float]  # what is done and returns the answer; how often
_Choice = TypeVar("_Choice")


class Habits(NamedTuple):
    """What can be asked of one bench."""

    goals: dict[str, float]  # by joint: the largest of random goals [rad]
    tunings: dict[str, list[dict[str, Any]]]  # by controller
    faults: list[dict[str, Any]]
    turns: list[dict[str, Any]]  # of appendages; none: none can turn


class Entry(NamedTuple):
    """A line of the diary."""

    act: str
    answer: str
    took: float  # [wall s]
    bench: str  # after it


class Desk:
    """What all acts share.

    Args:
        bench: that is operated.
        habits: what is asked of it.
        case: what is drawn from.

    Attributes:
        diary: what was done.
        braked: the brake is on, or will be with the next tick.
    """

    def __init__(self, bench: OperatedBench, habits: Habits, case: np.random.Generator) -> None:
        self.bench, self.habits, self.case = bench, habits, case
        self.diary: list[Entry] = []
        self.braked = False

    def pick(self, choices: Sequence[_Choice]) -> _Choice:
        """Return one of several."""
        return choices[int(self.case.integers(len(choices)))]

    def chance(self, share: float) -> bool:
        """Return whether something is done that is done in this share of all cases."""
        return bool(self.case.random() < share)

    def do(self, act: Callable[[], str]) -> None:
        """Do something; its answer is one line of the diary."""
        at, began = len(self.diary), monotonic()
        self.diary.append(Entry(act.__name__, "?", 0.0, ""))
        answer = act()
        state = self.bench.state
        who = state.active or "the brake"
        after = f"{state.state} at {state.tick} of {state.epoch} under {who}"
        self.diary[at] = Entry(act.__name__, answer, round(monotonic() - began, 2), after)
        assert answer.isprintable(), self.diary

    def ask(self, kind: Any, name: str, **fields: Any) -> Any:
        """Return the answer of a service."""
        return self.bench.first.ask(kind, name, **fields)

    def until(self, condition: Callable[[], bool]) -> None:
        """Listen until something is true; a failure shows the bench and the diary."""
        self.bench.first.until(condition, lambda: (self.bench.state, *self.diary))

    def granted(self, done: bool, message: str, expected: bool) -> str:
        """Return the message of an answer that must be granted, or refused in words."""
        assert done == expected, (message, self.diary)
        return self.worded(done, message)

    def worded(self, done: bool, message: str) -> str:
        """Return the message of an answer that may be granted, or refused in words."""
        assert message or done, self.diary
        return message

    def operate(self, action: str, expected: bool) -> str:
        """Start, pause, reset, brake or release the brake, in one of two ways."""
        if self.chance(0.5):
            reply = self.ask(srv.Operate, topics.OPERATE, action=action, who=WHO)
            return self.granted(reply.ok, reply.message, expected)
        reply = self.ask(Trigger, action)
        return self.granted(reply.success, reply.message, expected)
