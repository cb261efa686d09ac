"""What a user's own function cannot be compiled for, in one line."""

import inspect
import re
from collections.abc import Callable
from typing import Any

from numba.core.errors import NumbaError, UnsupportedBytecodeError

from flexslew_plant.errors import BadInput

_COLOR_CODES = re.compile(r"\x1b\[[0-9;]*m")
_STAGE = "Failed in nopython mode pipeline"  # how Numba begins
_WRITE_ERROR = "setitem(readonly array"


def convert_compile_errors(dispatcher: Any) -> Any:
    """Return a function of Numba that raises BadInput with its file and line if it is wrong."""
    compile_it: Callable[[Any], Any] = dispatcher.compile
    function = dispatcher.py_func

    def compile_checked(signature: Any) -> Any:
        try:
            return compile_it(signature)
        except (NumbaError, UnsupportedBytecodeError) as error:
            place = getattr(error, "loc", None)
            file = place.filename if place else inspect.getfile(function)
            line = f"line {place.line}" if place else "somewhere in it"
            name = function.__name__
            why = f"{name} cannot be compiled by Numba, {line}: {_reason(error)}"
            raise BadInput(why, file) from None

    dispatcher.compile = compile_checked
    return dispatcher


def _reason(error: Exception) -> str:
    """Return the first message of a Numba error, and its first call."""
    text = _COLOR_CODES.sub("", str(error))
    if _WRITE_ERROR in text:
        return "it writes into an argument that it may only read"
    lines = [line.strip() for line in text.splitlines()]
    error_lines = [line for line in lines if line and not line.startswith(_STAGE)]
    calls = [line.removeprefix(">>> ") for line in error_lines if line.startswith(">>> ")]
    return " ".join((*error_lines[:1], *calls[:1])).rstrip(".")
