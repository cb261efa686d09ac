"""A worst case as tables: for the page of an analysis and for a terminal."""

import numpy as np

from flexslew_lab.guarantee.figures import worst_case_figures
from flexslew_lab.guarantee.flight import Guarantee
from flexslew_lab.guarantee.worst_case import WORST_COLUMNS, WorstCase
from flexslew_lab.report.sections import Section, Table, Text
from flexslew_lab.short_values import in_columns

GAIN_COLUMNS = ("peak of", "centre", "found", "none above", "found at")


def gain_rows(found: WorstCase) -> list[list[str]]:
    """Return a row for each response, with the parameters of its largest peak found."""
    rows = in_columns(
        (g.name, g.nominal, g.found, "-" if np.isinf(g.bound) else g.bound) for g in found.gains
    )
    values = [", ".join(f"{k} {v:.4g}" for k, v in g.values.items()) for g in found.gains]
    return [[*row, at] for row, at in zip(rows, values, strict=True)]


def worst_case_sections(guarantee: Guarantee, command: str = "") -> list[Section]:
    """Return the tables, the curve of mu and the bands of the responses of a worst case.

    Args:
        guarantee: with the worst case and its loop.
        command: line of a shell that flies the nearest unstable loop.
    """
    found, verdict = guarantee.found, guarantee.verdict
    words = (
        f"{verdict[0].upper()}{verdict[1:]}. Certified in {len(found.certificate.parts)} parts of "
        f"the box, and checked at {found.certificate.checked} points by other means. "
        f"Fit of the loop's dynamics over the ranges: {found.fit.words}."
    )
    bounds = (
        "Peaks over all parameters within the certified part of the box: S and T at the plant's "
        "input [-], pointing from a disturbance of the efforts to the joints [rad/(N m) or m/N]."
    )
    sections: list[Section] = [
        Table("Guarantee", words, WORST_COLUMNS, found.rows),
        Text("Fly it", command if found.unstable is not None else ""),
        Table("Worst-case gains", bounds, GAIN_COLUMNS, gain_rows(found)),
    ]
    if found.certified > 0.0:
        sections += worst_case_figures(found, guarantee.varied)
    return sections
