"""Errors for the user: each message is one line with cause and remedy."""


class FlexslewError(Exception):
    """Anything the bench reports in one line instead of a traceback."""


class BadInput(FlexslewError):
    """A value from a person is not usable; nothing was changed. Exit code 2."""


class PlanFailed(FlexslewError):
    """A planner found no manoeuvre; the message carries the numbers that matter."""


class RunFault(FlexslewError):
    """A fault ended the run; what was recorded until then is whole. Exit code 3."""
