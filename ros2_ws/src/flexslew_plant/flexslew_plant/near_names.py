"""Which name was meant: for errors about names that there are not."""

import difflib
from collections.abc import Iterable

_ALIKE, _SHORT, _ALIKE_SHORT = 0.65, 4, 0.5  # of four letters one wrong one leaves less alike


def did_you_mean(given: object, known: Iterable[str]) -> str:
    """Return `did you mean NAME? ` where a known name is near, else an empty text.

    Args:
        given: what was written, of any length.
        known: the names that there are.
    """
    lowered = {name.lower(): name for name in known}
    word = str(given)[:100].lower()
    cutoff = _ALIKE_SHORT if len(word) <= _SHORT else _ALIKE
    close = difflib.get_close_matches(word, lowered, n=1, cutoff=cutoff)
    return f"did you mean {lowered[close[0]]}? " if close else ""
