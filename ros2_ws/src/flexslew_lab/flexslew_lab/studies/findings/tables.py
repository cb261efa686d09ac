"""The numbers of a study as words in tables, the same on its page and on a terminal."""

from typing import Any, NamedTuple

from flexslew_lab.short_values import short
from flexslew_lab.studies.findings.criteria import Decision
from flexslew_lab.studies.findings.summary import QUANTILES
from flexslew_plant.counted import count_text

_DIGITS = 3
QUANTILE_NAMES = ("median", *(f"{100 * q:g} %" for q in QUANTILES[1:]))


class MetricRow(NamedTuple):
    """What a variant shows of one metric."""

    name: str
    unit: str
    mean: str
    quantiles: tuple[str, ...]  # of QUANTILES, with bounds
    failed: int
    missing: int


class PairRow(NamedTuple):
    """How a variant stands to the first one in one metric."""

    metric: str
    variant: str
    verdict: str  # smaller, larger or undecided
    shares: str  # of pairs in which it is smaller and larger
    mean: str  # of the differences, with bounds
    median: str
    p_value: str
    pairs: str  # how many, and how many of them with a failure or left out


def metric_tables(found: dict[str, Any]) -> dict[str, list[MetricRow]]:
    """Return the rows of each variant by its label, without those that have no information."""
    tables = {}
    for label in found["variants"]:
        rows = []
        for name, metric in found["metrics"].items():
            variant_metric = metric["variants"][label] if "variants" in metric else metric
            if "." not in name and not _is_empty(variant_metric):
                rows.append(_row(name, metric["unit"], variant_metric))
        tables[label] = rows
    return tables


def total_rows(found: dict[str, Any]) -> list[MetricRow]:
    """Return the rows over all variants together."""
    each = {name: metric for name, metric in found["metrics"].items() if "." not in name}
    return [_row(name, m["unit"], m) for name, m in each.items() if not _is_empty(m)]


def pair_rows(found: dict[str, Any]) -> list[PairRow]:
    """Return the differences to the first variant."""
    return [
        PairRow(
            row["metric"],
            row["variant"],
            row["verdict"],
            f"{_percent(row['smaller'])} / {_percent(row['larger'])}",
            _mean(row["mean"]),
            bounded(row["median"]) if row["pairs"] else "-",
            short(row["p_value"], 2),
            _pairs(row),
        )
        for row in found["paired"]
    ]


def criterion_words(row: dict[str, Any]) -> str:
    """Return in words a criterion and the result of the trials."""
    side = f"below {row['below']:g}" if row["below"] is not None else f"above {row['above']:g}"
    who = f" ({row['variant']})" if row["variant"] else ""
    words = f"{row['metric']} {side}{who}: {row['successes']} of {row['trials']}"
    if row["probability"] is None:
        return f"{words}, required of all {row['planned']}"
    if row["lower_bound"] is None:
        return f"{words}, no bounds by this sampling, required {row['probability']:g}"
    return (
        f"{words}; at {100 * row['confidence']:g} % at least {row['lower_bound']:.5f} and, as "
        f"surely, at most {row['upper_bound']:.5f}, required {row['probability']:g}; this many "
        f"failures need {row['needed']} trials"
    )


def study_verdict(found: dict[str, Any]) -> str:
    """Return what a study decides, in a sentence; the worst criterion is stated in full.

    Args:
        found: see summary.
    """
    rows = {d: [r for r in found["criteria"] if r["verdict"] == d.value] for d in Decision}
    counts = ", ".join(f"{len(some)} {d.value}" for d, some in rows.items() if some)
    total = count_text(len(found["criteria"]), "criterion", "criteria")
    parts = ["" if found["complete"] else "incomplete", f"{total}: {counts}" if counts else ""]
    worst = (*rows[Decision.REJECTED], *rows[Decision.UNKNOWN])[:1]
    parts.extend(f"{row['verdict']}: {criterion_words(row)}" for row in worst)
    parts.append(f"{found['failed']} of {count_text(found['trials'], 'trial')} failed")
    return "; ".join(part for part in parts if part)


def bounded(bounds: list[float | None]) -> str:
    """Return an estimate with its bounds in brackets."""
    low, estimate, high = bounds
    if low is None and high is None:
        return "unbounded" if estimate is None else short(estimate, _DIGITS)
    ends = (
        "-∞" if low is None else short(low, _DIGITS),
        "∞" if high is None else short(high, _DIGITS),
    )
    text = "∞" if estimate is None else short(estimate, _DIGITS)
    return f"{text} [{ends[0]}, {ends[1]}]"


def _row(name: str, unit: str, metric: dict[str, Any]) -> MetricRow:
    quantiles = tuple(bounded(b) for b in metric["quantiles"].values())
    low, high = metric["mean_bounds"]
    mean = _mean([low, metric["mean"], high])
    return MetricRow(name, unit, mean, quantiles, metric["failed"], metric["missing"])


def _mean(bounds: list[float | None]) -> str:
    """Return a mean with its bounds; there is none with a failure, or without a number."""
    return "-" if bounds[1] is None else bounded(bounds)


def _is_empty(metric: dict[str, Any]) -> bool:
    """Return whether no trial has a metric, or it is 0 in all that have it and none failed."""
    if 0 < metric["missing"] == metric["trials"] - metric["failed"]:
        return True
    ends = [b for bounds in metric["quantiles"].values() for b in bounds[1:2]]
    return metric["mean"] == 0.0 and not any(ends) and not metric["failed"]


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100.0 * share:.3g} %"


def _pairs(row: dict[str, Any]) -> str:
    words = str(row["pairs"])
    if row["with_failure"]:
        words += f", {row['with_failure']} with a failure"
    if row["without_number"]:
        words += f", {row['without_number']} without a number left out"
    return words


def missing_words(found: dict[str, Any]) -> str:
    """Return what is missing of a study that is not flown to its end; empty: nothing."""
    if found["complete"]:
        return ""
    missing = found["to_fly"] - found["trials"]
    return (
        f"{missing} of {found['to_fly']} trials are missing; all figures are of the other "
        f"{found['trials']}: run the study, or its other shards, to the end"
    )
