"""Results of a study on a terminal."""

from collections.abc import Sequence
from typing import Any

from flexslew_lab.cli.terminal import print_message, print_table, print_verdict
from flexslew_lab.json_text import json_text
from flexslew_lab.short_values import short


def print_summary(found: dict[str, Any], as_json: bool) -> None:
    """Print what a study found: a table for people, or the whole summary as JSON."""
    if as_json:
        print(json_text(found))
        return
    from flexslew_lab.studies.findings.criteria import Decision
    from flexslew_lab.studies.findings.tables import (
        QUANTILE_NAMES,
        criterion_words,
        metric_tables,
        missing_words,
        pair_rows,
        study_verdict,
    )

    colors = {Decision.PASSED: "green", Decision.REJECTED: "red", Decision.UNKNOWN: "yellow"}
    rate = found["trials_per_second"]
    rows = [
        ("trials", f"{found['trials']} of {found['planned']}, {found['failed']} failed"),
        ("wall time", f"{short(found['wall_time'])} s, {short(rate)} trials/s"),
        ("flown by", short(found["ways"])),
        ("bounds from", found["sampling"]["bounds"]),
        ("table", found["table"]),
        ("report", found.get("report", "-")),
    ]
    print_verdict(study_verdict(found))
    print_table(("", found["study"]), rows)
    if words := missing_words(found):
        print_message(words, "red", head="incomplete: ")
    for label, lines in metric_tables(found).items():
        print_table(
            (label or "metric", "unit", "mean", *QUANTILE_NAMES, "failed", "missing"),
            [
                (*row[:3], *row.quantiles, row.failed or "", row.missing or "")  # name, unit, mean
                for row in lines
            ],
        )
    if found["paired"]:
        against = found["paired"][0]["against"]
        header = ("smaller / larger in", "mean difference", "median difference", "p", "pairs")
        print_table((f"against {against}", "variant", "is", *header), pair_rows(found))
    for row in found["criteria"]:
        verdict = Decision(row["verdict"])
        print_message(f" {criterion_words(row)}", head=verdict.value, head_style=colors[verdict])


def side_by_side(names: Sequence[str], found: list[dict[str, Any]]) -> None:
    """Print the 99 % quantiles of two studies side by side."""
    from flexslew_lab.studies.findings.tables import total_rows

    first, second = ({row.name: row.quantiles[-1] for row in total_rows(one)} for one in found)
    lines = [(name, value, second[name]) for name, value in first.items() if name in second]
    print_table(("99 % of", *names), lines)
