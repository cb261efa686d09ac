"""Errors for the user: each message is one line with cause and remedy."""


class FlexslewError(Exception):
    """Anything the bench reports in one line instead of a traceback."""

    def __str__(self) -> str:
        """Return the message; what would break its line, or does not show, is escaped."""
        text = super().__str__()
        return text if text.isprintable() else "".join(map(_shown, text))


def _shown(letter: str) -> str:
    return letter if letter.isprintable() else ascii(letter)[1:-1]


class BadInput(FlexslewError):
    """A value from a person is not usable; nothing was changed. Exit code 2."""


class PlanFailed(FlexslewError):
    """A planner found no manoeuvre; the message carries the numbers that matter."""


class RunFault(FlexslewError):
    """A fault ended the run; what was recorded until then is whole. Exit code 3."""
