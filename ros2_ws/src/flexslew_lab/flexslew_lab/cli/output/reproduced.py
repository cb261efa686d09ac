"""What `flexslew reproduce` shows: each row with what its tolerance is of, and what was counted."""

from collections.abc import Sequence
from typing import Any

from flexslew_lab.cli.terminal import print_message, print_table
from flexslew_lab.short_values import short

_COLUMNS = ("item", "paper", "reference", "ours", "tolerance", "state")


def show_rows(name: str, rows: Sequence[dict[str, Any]]) -> None:
    """Print the rows of a reproduction, how many are near, and why others are not reproduced.

    Args:
        name: of the reproduction.
        rows: see reproduce.rows.
    """
    print_table(_COLUMNS, [_cells(row) for row in rows])
    passed = sum(row["ok"] is True for row in rows)
    off = sum(row["ok"] is False for row in rows)
    left = [row for row in rows if row["ok"] is None]
    summary = [f"{name}: {passed} of {len(rows)} within tolerance"]
    summary += [f"{off} off"] * (off > 0) + [f"{len(left)} not reproduced"] * bool(left)
    print_message(", ".join(summary), "bold")
    for why in dict.fromkeys(row["because"] for row in left):
        names = [row["item"] for row in left if row["because"] == why]
        more = f" and {len(names) - 1} more" if len(names) > 1 else ""
        print_message(f"not reproduced, because {why} ({names[0]}{more})")


def _cells(row: dict[str, Any]) -> list[str]:
    """Return the cells of a row."""
    kind = row["tolerance_is"]
    tolerance = f"{short(row['tolerance'])} {kind}" if kind in ("absolute", "relative") else kind
    state = {True: "within", False: "off", None: "not reproduced"}[row["ok"]]
    numbers = [short(row[key]) for key in ("item", "paper", "reference", "ours")]
    return [*numbers, tolerance, state]
