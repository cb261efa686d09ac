"""Which name was meant: for errors about names that there are not."""

import difflib
from collections.abc import Iterable

_CUTOFF, _SHORT, _SHORT_CUTOFF = 0.65, 4, 0.5  # of four letters one wrong one leaves less alike


def spelling_hint(given: object, known: Iterable[str]) -> str:
    """Return `did you mean NAME? ` where a known name is near, else an empty text.

    Args:
        given: what was written, of any length.
        known: the names that there are.
    """
    lower_names = {name.lower(): name for name in known}
    word = str(given)[:100].lower()
    cutoff = _SHORT_CUTOFF if len(word) <= _SHORT else _CUTOFF
    close = difflib.get_close_matches(word, lower_names, n=1, cutoff=cutoff)
    return f"did you mean {lower_names[close[0]]}? " if close else ""
