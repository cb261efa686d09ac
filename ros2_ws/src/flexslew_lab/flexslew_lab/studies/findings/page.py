"""The pages of studies: one HTML file with everything in it."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import plotly.graph_objects as go

from flexslew_lab.report.page import render
from flexslew_lab.report.tables import Table, tables_page
from flexslew_lab.short_values import short
from flexslew_lab.studies.findings import figures
from flexslew_lab.studies.findings.tables import (
    QUANTILE_NAMES,
    metric_tables,
    missing_words,
    pair_rows,
    total_rows,
)
from flexslew_lab.studies.store import Store
from flexslew_lab.studies.study import Study
from flexslew_plant.counted import count_text

_MAX_FIGURES = 3  # metrics with figures of their own, where no criterion names any
_FIRST = ("residual_tip_deflection", "residual_attitude_error", "settling_time")


def study_page(study: Study, store: Store, found: dict[str, Any]) -> str:
    """Return the page of one study: its criteria, its results, its worst trials."""
    names = [n for n in study.settings.criteria if n in found["metrics"]]
    names = list(dict.fromkeys([*names, *(n for n in _FIRST if n in found["metrics"])]))[
        :_MAX_FIGURES
    ]
    other_figures = []
    for name in names:
        each = figures.columns(study, store, name)
        unit = found["metrics"][name]["unit"]
        other_figures.append(
            {
                "name": name,
                "distribution": _html(figures.distribution(study, store, name, unit, each)),
                "scatter": _html(figures.scatter(study, store, name, unit)),
                "maps": [_html(m) for m in figures.maps(study, store, name, unit)],
            }
        )
    return render(
        "study.html.j2",
        found=found,
        missing=missing_words(found),
        title=study.settings.study,
        file=study.source,
        folder=str(store.folder),
        trial=study.trial_source,
        tables=metric_tables(found),
        pairs=pair_rows(found),
        quantiles=QUANTILE_NAMES,
        drawn=other_figures,
        worst=_worst(store, found, names),
        sensitivity=[
            (line, _html(figures.sensitivity(line)) if line["indices"] else "")
            for line in found["sensitivity"]
        ],
        short=partial(short, digits=3),
    )


def names_of(opened: Sequence[tuple[Study, Store]]) -> list[str]:
    """Return what studies are called side by side: with their folders where names are equal."""
    names = [study.settings.study for study, _ in opened]
    places: tuple[Callable[[Path], str], ...] = (lambda folder: folder.name, str)
    for place in places:
        if len({*names}) < len(names):
            names = [f"{study.settings.study} ({place(store.folder)})" for study, store in opened]
    return names


def comparison_page(opened: list[tuple[Study, Store]], found: list[dict[str, Any]]) -> str:
    """Return the page of two studies side by side."""
    studies = names_of(opened)
    common = [n for n in found[0]["metrics"] if n in found[1]["metrics"] and "." not in n]
    requested = [n for n in opened[0][0].settings.criteria if n in common]
    names = list(dict.fromkeys([*requested, *(n for n in _FIRST if n in common)]))[:_MAX_FIGURES]
    other_figures = []
    for name in names:
        each = {
            ", ".join(filter(None, (called, label))): values
            for called, (study, store) in zip(studies, opened, strict=True)
            for label, values in figures.columns(study, store, name).items()
        }
        unit = found[0]["metrics"][name]["unit"]
        other_figures.append((name, _html(figures.distribution_figure(each, name, unit))))
    row_by_name = [{row.name: row for row in total_rows(one)} for one in found]
    rows = [
        (
            name,
            *(one[name].mean for one in row_by_name),
            *(one[name].quantiles[-1] for one in row_by_name),
        )
        for name in common
        if all(name in one for one in row_by_name)
    ]
    means, quantiles = ([f"{of}, {called}" for called in studies] for of in ("mean", "99 %"))
    criteria = [
        (
            called,
            str(row["metric"]),
            str(row["variant"] or ""),
            f"{row['successes']} of {row['trials']}",
            short(row["lower_bound"], digits=3),
            row["verdict"],
        )
        for called, one in zip(studies, found, strict=True)
        for row in one["criteria"]
    ]
    header = ("study", "metric", "variant", "kept to", "lower bound", "")
    description = "; ".join(
        f"{called}: {count_text(one['trials'], 'trial')}, {one['failed']} failed, "
        f"{'' if one['complete'] else 'incomplete, '}"
        f"{one['sampling']['method']}"
        for called, one in zip(studies, found, strict=True)
    )
    tables = (
        Table("Metrics", "", ("metric", *means, *quantiles), rows),
        Table("Criteria", "", header, criteria),
    )
    return tables_page(
        "study", " and ".join(studies), description, tables, other_figures=other_figures
    )


def _html(figure: go.Figure) -> str:
    return str(figure.to_html(full_html=False, include_plotlyjs=False))


def _worst(store: Store, found: dict[str, Any], names: list[str]) -> list[dict[str, Any]]:
    """Return the worst trials of the shown metrics with the command that flies them again."""
    return [
        {
            "metric": name,
            "index": entry["index"],
            "value": _worst_value(entry),
            "command": f"./flexslew study fly {store.folder} {entry['index']}",
        }
        for name in names
        for entry in found["metrics"][name]["worst"]
    ]


def _worst_value(entry: dict[str, Any]) -> str:
    if entry["failed"]:
        return "failed"
    return "never" if entry["value"] is None else short(entry["value"])
