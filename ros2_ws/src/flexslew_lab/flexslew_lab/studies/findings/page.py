"""The pages of studies: one HTML file with everything in it."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from flexslew_lab.report.sections import Section, Table, Text, page_of_sections
from flexslew_lab.short_values import short
from flexslew_lab.studies.findings import figures
from flexslew_lab.studies.findings.tables import (
    QUANTILE_NAMES,
    metric_tables,
    missing_words,
    pair_rows,
    study_verdict,
    total_rows,
)
from flexslew_lab.studies.store import Store
from flexslew_lab.studies.study import Study
from flexslew_plant.counted import count_text

_MAX_FIGURES = 3  # metrics with figures of their own, where no criterion names any
_FIRST = ("residual_tip_deflection", "residual_attitude_error", "settling_time")
_digits = partial(short, digits=3)


def study_page(study: Study, store: Store, found: dict[str, Any]) -> str:
    """Return the page of one study: its criteria, its results, its worst trials."""
    sampling = found["sampling"]
    description = (
        f"{found['trials']} of {found['planned']} trials · "
        f"{sampling['method']} · bounds from: {sampling['bounds']} · {study.source}, "
        f"{study.trial_source}"
    )
    sections = _study_sections(study, store, found)
    words = study_verdict(found)
    return page_of_sections("study", study.settings.study, description, sections, words)


def _study_sections(study: Study, store: Store, found: dict[str, Any]) -> Iterator[Section]:
    """Yield the sections of the page of one study."""
    yield Text("Incomplete", missing_words(found), "bad")
    damaged = (
        f"{', '.join(found['damaged'])}: not as written. Their trials are not counted here, and "
        "the next run of the study flies them again."
    )
    yield Text("Damaged parts", damaged if found["damaged"] else "", "bad")
    words = "They count as worse than any number, and as breaking every criterion."
    yield Table("Failed trials", words, (), list(found["reasons"].items()))
    yield _criteria(found)
    yield from _metrics(found)
    yield _pairs(found)
    names = _figure_metrics(study, found["metrics"])
    for name in names:
        unit = found["metrics"][name]["unit"]
        each = figures.columns(study, store, name)
        yield figures.distribution(study, store, name, unit, each)
        yield figures.scatter(study, store, name, unit)
        yield from figures.maps(study, store, name, unit)
    for line in found["sensitivity"]:
        if line["indices"]:
            yield figures.sensitivity(line)
        else:
            reason = f"No Sobol indices: {line['why_not']}."
            yield Text(figures.sensitivity_title(line), reason)
    worst = [
        (name, entry["index"], _worst_value(entry),
         f"./flexslew study fly {store.folder} {entry['index']}")
        for name in names
        for entry in found["metrics"][name]["worst"]
    ]  # fmt: skip
    yield Table("Worst trials", "", ("metric", "trial", "value", "fly it again"), worst)
    yield from _execution(found)


def _figure_metrics(study: Study, metrics: Sequence[str] | dict[str, Any]) -> list[str]:
    """Return the metrics with figures: those of criteria, then the usual ones."""
    names = dict.fromkeys([*study.settings.criteria, *_FIRST])
    return [name for name in names if name in metrics][:_MAX_FIGURES]


def _criteria(found: dict[str, Any]) -> Table:
    rows, units = [], {name: metric["unit"] for name, metric in found["metrics"].items()}
    for row in found["criteria"]:
        side, limit = ("<", row["below"]) if row["below"] is not None else (">", row["above"])
        numbers = (row[key] for key in ("estimate", "lower_bound", "upper_bound", "confidence"))
        rows.append(
            (
                f"{row['metric']} {side} {_digits(limit)} {units[row['metric']]}",
                row["variant"],
                row["verdict"],
                f"{row['successes']} of {row['trials']}",
                *map(_digits, numbers),
                "all" if row["probability"] is None else row["probability"],
                _digits(row["needed"]),
            )
        )
    words = (
        "Passed: shown at the confidence that was asked for. Refuted: the opposite is. Undecided: "
        "these trials show neither."
    )
    columns = ("metric", "variant", "", "kept to", "estimate", "at least", "at most", "each at",
               "required", "trials that this many failures need")  # fmt: skip
    return Table("Criteria", words, columns, rows)


def _metrics(found: dict[str, Any]) -> Iterator[Table]:
    tables = metric_tables(found)
    all_variants = ", of all variants at once" if len(tables) > 1 else ""
    words = f"In brackets: bounds at 90 %{all_variants}."
    if found["sampling"]["bounds"] == "none":
        words = "This sampling gives no bounds."
    words += (
        " Missing: trials that have no such number. Metrics that are 0 in every trial are left out."
    )
    columns = ("metric", "unit", "mean", *QUANTILE_NAMES, "failed", "missing")
    for label, rows in tables.items():
        cells = [(*r[:3], *r.quantiles, r.failed or "", r.missing or "") for r in rows]
        yield Table(f"Metrics: {label}" if label else "Metrics", words, columns, cells)
        words = ""


def _pairs(found: dict[str, Any]) -> Table:
    rows = pair_rows(found)
    against = found["paired"][0]["against"] if rows else ""
    bounds = found["sampling"]["bounds"]
    words = (
        f"Each variant minus {against}, trial by trial on the same samples with the same noise; a "
        "failure counts as the worse of its pair. "
        + ("In brackets: bounds at 90 %, of all variants at once. " if bounds != "none" else "")
        + "Smaller or larger where a sign test shows it at 90 % for all variants of a metric at "
        "once: it assumes that pairs are independent"
        + (
            ", or, from replicates, that their mean signs are spread like a normal distribution"
            if bounds != "independent samples"
            else ""
        )
        + ", and nothing of how differences are spread."
    )
    columns = ("metric", "variant", "is", "smaller / larger in", "mean difference",
               "median difference", "p", "pairs")  # fmt: skip
    return Table("Paired differences", words, columns, rows)


def _execution(found: dict[str, Any]) -> Iterator[Text]:
    words = [f"{count} trials by {way}." for way, count in found["ways"].items()]
    if found["wall_time"]:
        rate = _digits(found["trials_per_second"])
        words.append(f"{_digits(found['wall_time'])} s of wall time, {rate} trials/s.")
    if stopped := found["stopped"]:
        words.append(
            f"Stopped after {stopped['samples']} samples: {_digits(stopped['quantile'] * 100)} % "
            f"of {stopped['metric']} are known to ± {_digits(stopped['half_width'])} at "
            f"{_digits(stopped['confidence'] * 100)} %."
        )
    yield Text("How it was flown", " ".join([*words, f"Table: {found['table']}"]))
    if check := found["check"]:
        verdict = (
            f"{check['trials']} trials of the batches flown again by the ordinary bench: largest "
            f"difference {_digits(check['largest'])} ({check['metric']}, trial {check['index']}), "
            f"allowed {_digits(check['tolerance'])}."
        )
        yield Text("Check of the batches", verdict, "good" if check["ok"] else "bad")


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
            row["metric"],
            row["variant"] or "",
            f"{row['successes']} of {row['trials']}",
            _digits(row["lower_bound"]),
            row["verdict"],
        )
        for called, one in zip(studies, found, strict=True)
        for row in one["criteria"]
    ]
    header = ("study", "metric", "variant", "kept to", "lower bound", "")
    description = "; ".join(
        f"{called}: {count_text(one['trials'], 'trial')}, {one['sampling']['method']}"
        for called, one in zip(studies, found, strict=True)
    )
    sections: list[Section] = [
        Table("Metrics", "", ("metric", *means, *quantiles), rows),
        Table("Criteria", "", header, criteria),
    ]
    for name in _figure_metrics(opened[0][0], common):
        each = {
            ", ".join(filter(None, (called, label))): values
            for called, (study, store) in zip(studies, opened, strict=True)
            for label, values in figures.columns(study, store, name).items()
        }
        sections.append(figures.distributions(each, name, found[0]["metrics"][name]["unit"]))
    words = "; ".join(
        f"{called}: {study_verdict(one)}" for called, one in zip(studies, found, strict=True)
    )
    return page_of_sections("study", " and ".join(studies), description, sections, words)


def _worst_value(entry: dict[str, Any]) -> str:
    if entry["failed"]:
        return "failed"
    return "never" if entry["value"] is None else short(entry["value"])
