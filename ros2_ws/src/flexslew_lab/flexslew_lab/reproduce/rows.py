"""Rows of a reproduction: {item, paper, reference, ours, tolerance, tolerance_is, ok, because}.

`paper` is what the paper prints, or where the reference is from; `reference` was computed in
another way than `ours`. `ok`: whether ours is near it; None: it is not reproduced, `because`.
"""

from typing import Any, Literal

Row = dict[str, Any]
KEYS = ("item", "paper", "reference", "ours", "tolerance", "tolerance_is", "ok", "because")


def absolute(item: str, paper: Any, reference: float, ours: float, tolerance: float) -> Row:
    """Return a row of which the difference is at most the tolerance, in the item's unit."""
    ok = abs(ours - reference) <= tolerance
    return _row(item, paper, reference, ours, tolerance, "absolute", ok)


def relative(item: str, paper: Any, reference: float, ours: float, tolerance: float) -> Row:
    """Return a row of which the difference is at most a part of the reference."""
    ok = abs(ours - reference) <= tolerance * abs(reference)
    return _row(item, paper, reference, ours, tolerance, "relative", ok)


def at_most(item: str, paper: Any, limit: float, ours: float) -> Row:
    """Return a row with an upper bound as reference."""
    return _row(f"{item} (at most)", paper, limit, ours, 0.0, "at most", ours <= limit)


def equal(item: str, paper: Any, reference: str, ours: Any) -> Row:
    """Return a row with a word as reference, or with a word where one belongs."""
    return _row(item, paper, reference, ours, 0.0, "equal", reference == ours)


def not_reproduced(item: str, paper: Any, reference: Any, ours: Any, because: str) -> Row:
    """Return a row that shows both numbers and why they differ."""
    found = _row(item, paper, reference, ours, 0.0, "", False)
    return {**found, "ok": None, "because": because}


def _row(
    item: str,
    paper: Any,
    reference: Any,
    ours: Any,
    tolerance: float,
    kind: Literal["absolute", "relative", "at most", "equal", ""],
    ok: bool,
) -> Row:
    values = (item, paper, reference, ours, tolerance, kind, bool(ok), "")
    return dict(zip(KEYS, values, strict=True))
