"""Errors for the user: each message is one line with cause and remedy."""

from dataclasses import dataclass, replace
from typing import Any

from flexslew_plant.refusal import NO_VALUE, Refusal, one_line


class FlexslewError(Exception):
    """Anything the bench reports in one line instead of a traceback."""

    def __str__(self) -> str:
        """Return the message; what would break its line, or does not show, is escaped."""
        return one_line(super().__str__())


@dataclass(eq=False)
class BadInput(FlexslewError):
    """A value from a person is not usable; nothing was changed. Exit code 2.

    Args:
        why: the refusal; or what is allowed, or what is wrong and what to do.
        source: the file, node or option.
        key: the value's place in it.
        value: that is not allowed; left out where it is about none.
    """

    why: Refusal | str = ""
    source: object = ""
    key: str = ""
    value: Any = NO_VALUE

    def __str__(self) -> str:
        """Return the refusal in one line; see FlexslewError."""
        return one_line(str(self.refusal))

    @property
    def refusal(self) -> Refusal:
        """What is not allowed, part by part."""
        if isinstance(self.why, Refusal):
            return self.why
        return Refusal(self.why, self.key, self.value, str(self.source))


def without_source(error: FlexslewError) -> str:
    """Return an error in one line without the name of the file that it is about."""
    return str(replace(error.refusal, source="")) if isinstance(error, BadInput) else str(error)


class PlanFailed(FlexslewError):
    """A planner found no manoeuvre; the message carries the numbers that matter."""


class RunFault(FlexslewError):
    """A fault ended the run; what was recorded until then is whole. Exit code 3."""
