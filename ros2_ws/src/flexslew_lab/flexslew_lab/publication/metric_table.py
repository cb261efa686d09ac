"""Metrics of runs as a table for a paper: LaTeX or CSV, one column per run."""

import csv
from collections.abc import Iterable, Sequence
from io import StringIO
from pathlib import Path
from typing import Any

from flexslew_lab.log.files.whole_file import write_whole
from flexslew_lab.metrics.rows import flat, row_unit
from flexslew_lab.publication.channels import LabelledRun
from flexslew_lab.publication.figure import format_of, latex_text
from flexslew_lab.report.report import KEY_METRICS
from flexslew_plant.errors import BadInput
from flexslew_plant.near_names import spelling_hint

TABLE_FORMATS = ("tex", "csv")
_Row = tuple[str, str, list[Any]]  # name, unit, one value per run


def write_metric_table(runs: Sequence[LabelledRun], to: Path, metrics: Sequence[str] = ()) -> None:
    """Write the table of runs.

    Args:
        runs: with the titles of their columns.
        to: file, .tex or .csv.
        metrics: names of rows or keys of metrics.json; none: the main ones of a report.

    Raises:
        BadInput: if a metric or the file is not allowed.
    """
    kind = format_of(to, "--table", TABLE_FORMATS)
    rows = metric_rows_of(runs, metrics)
    to.parent.mkdir(parents=True, exist_ok=True)
    labels = [run.label for run in runs]
    write_whole(to, _latex(labels, rows) if kind == "tex" else _csv(labels, rows))


def metric_rows_of(runs: Sequence[LabelledRun], metrics: Sequence[str] = ()) -> list[_Row]:
    """Return the rows of a table; see write_metric_table."""
    each = [flat(run.flight.metrics) for run in runs]
    known = list(dict.fromkeys(name for values in each for name in values))
    keys = dict.fromkeys(name.partition(".")[0] for name in known)
    found: list[_Row] = []
    for given in metrics or KEY_METRICS:
        names = [name for name in known if given in (name, name.partition(".")[0])]
        if not names and metrics:
            words = f"is no metric of these runs; {spelling_hint(given, [*keys, *known])}there are "
            raise BadInput(f"--metrics: {given} {words}{', '.join(keys)}")
        for name in names:
            values = [row.get(name) for row in each]
            if any(value is not None for value in values):
                found.append((name, _unit(runs, name), values))
    return found


def _unit(runs: Sequence[LabelledRun], name: str) -> str:
    """Return the unit of a row, from the first run that has one."""
    for _, flight in runs:
        joints = {n.partition(".")[2]: u for n, u in flight.units.items() if n[:9] == "measured."}
        if unit := row_unit(name, joints, flight.user_keys):
            return unit
    return ""


def _csv(labels: Sequence[str], rows: Sequence[_Row]) -> str:
    """Return a table with all digits; an empty cell is a metric that a run does not have."""
    head = ["metric", "unit", *labels]
    return csv_text([head, *([name, unit, *values] for name, unit, values in rows)])


def csv_text(rows: Iterable[Sequence[Any]]) -> str:
    """Return rows as CSV; None is an empty cell."""
    text = StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def _latex(labels: Sequence[str], rows: Sequence[_Row]) -> str:
    """Return a tabular of three digits, with the rules of the package booktabs."""
    cells = [
        (
            latex_text(name.replace("_", " ").replace(".", ", ")),
            latex_text(unit).replace(" ", "\\,"),
            *map(latex_number, values),
        )
        for name, unit, values in rows
    ]
    return latex_tabular(["metric", "unit", *labels], cells, 2)


def latex_tabular(head: Sequence[str], rows: Sequence[Sequence[str]], words: int) -> str:
    """Return a tabular with the rules of the package booktabs.

    Args:
        head: of the columns, as text.
        rows: cells as LaTeX.
        words: how many of the first columns are words, at the left; numbers are at the right.
    """
    lines = [
        "% \\usepackage{booktabs}",
        f"\\begin{{tabular}}{{{'l' * words}{'r' * (len(head) - words)}}}",
        "\\toprule",
        f"{' & '.join(map(latex_text, head))} \\\\",
        "\\midrule",
        *(f"{' & '.join(cells)} \\\\" for cells in rows),
    ]
    return "\n".join([*lines, "\\bottomrule", "\\end{tabular}", ""])


def latex_number(value: Any) -> str:
    """Return a value for LaTeX: a number in three digits, as a power of ten where it is short."""
    if value is None:
        return "--"
    if not isinstance(value, float):
        return latex_text(str(value))
    mantissa, letter, exponent = f"{value:.3g}".partition("e")
    return f"${mantissa} \\times 10^{{{int(exponent)}}}$" if letter else f"${mantissa}$"
