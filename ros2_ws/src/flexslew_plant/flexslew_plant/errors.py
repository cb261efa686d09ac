"""Errors for the user: each message is one line with cause and remedy."""

from flexslew_plant.refusal import Refusal, one_line


class FlexslewError(Exception):
    """Anything the bench reports in one line instead of a traceback."""

    def __str__(self) -> str:
        """Return the message; what would break its line, or does not show, is escaped."""
        return one_line(super().__str__())


class BadInput(FlexslewError):
    """A value from a person is not usable; nothing was changed. Exit code 2.

    Args:
        why: the refusal, or a sentence that names what is wrong.
    """

    def __init__(self, why: Refusal | str = "") -> None:
        super().__init__(why)

    @property
    def refusal(self) -> Refusal:
        """What is not allowed, part by part."""
        (why,) = self.args
        return why if isinstance(why, Refusal) else Refusal(why)


class PlanFailed(FlexslewError):
    """A planner found no manoeuvre; the message carries the numbers that matter."""


class RunFault(FlexslewError):
    """A fault ended the run; what was recorded until then is whole. Exit code 3."""
