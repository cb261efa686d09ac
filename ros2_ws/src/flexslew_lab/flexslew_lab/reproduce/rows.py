"""Rows of a reproduction: {item, paper, reference, ours, tolerance, tolerance_is, ok, because}.

`paper` is what the paper prints, or where the reference is from; `reference` was computed in
another way than `ours`. `ok`: whether ours is near it; None: it is not reproduced, `because`.
"""

from typing import Any, Literal

Row = dict[str, Any]
KEYS = ("item", "paper", "reference", "ours", "tolerance", "tolerance_is", "ok", "because")


def absolute(item: str, source: Any, reference: float, computed: float, tolerance: float) -> Row:
    """Return a row of which the difference is at most the tolerance, in the item's unit."""
    ok = abs(computed - reference) <= tolerance
    return _row(item, source, reference, computed, tolerance, "absolute", ok)


def relative(item: str, source: Any, reference: float, computed: float, tolerance: float) -> Row:
    """Return a row of which the difference is at most a part of the reference."""
    ok = abs(computed - reference) <= tolerance * abs(reference)
    return _row(item, source, reference, computed, tolerance, "relative", ok)


def at_most(item: str, source: Any, limit: float, computed: float) -> Row:
    """Return a row with an upper bound as reference."""
    return _row(f"{item} (at most)", source, limit, computed, 0.0, "at most", computed <= limit)


def equal(item: str, source: Any, reference: str, computed: Any) -> Row:
    """Return a row with a word as reference, or with a word where one belongs."""
    return _row(item, source, reference, computed, 0.0, "equal", reference == computed)


def difference_row(item: str, source: Any, reference: Any, computed: Any, reason: str) -> Row:
    """Return a row that shows both numbers and why they differ."""
    found = _row(item, source, reference, computed, 0.0, "", False)
    return {**found, "ok": None, "because": reason}


def _row(
    item: str,
    source: Any,
    reference: Any,
    computed: Any,
    tolerance: float,
    kind: Literal["absolute", "relative", "at most", "equal", ""],
    ok: bool,
) -> Row:
    values = (item, source, reference, computed, tolerance, kind, bool(ok), "")
    return dict(zip(KEYS, values, strict=True))
