"""report.html: one file with everything in it, made from bags alone."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jinja2
import plotly.graph_objects as go
import yaml
from plotly.offline import get_plotlyjs

from flexslew_lab.log.bag_layout import RUN_RECORD, TRIAL_RECORD
from flexslew_lab.report import figures
from flexslew_lab.report.metric_schema import METRICS
from flexslew_lab.report.run_data import RunData, read_run
from flexslew_lab.report.scene_data import scene_of

EVENTS = 300  # of a run that the table shows
HEADLINES = (
    "residual_tip_deflection",
    "residual_attitude_error",
    "settling_time",
    "peak_effort",
    "control_effort",
    "missed_ticks",
)


class _Figure(NamedTuple):
    id: str
    json: str


class _Section(NamedTuple):
    title: str
    words: str
    figures: list[_Figure]


def write_report(
    bags: Sequence[Path],
    out: Path,
    comparison: Path | None = None,
    labels: Sequence[str] = (),
) -> Path:
    """Return the path of the report that was written.

    Args:
        bags: the run; with more than one they are overlaid, the first one leads.
        out: the HTML file.
        comparison: a bag of the same trial without feedforward, for a comparison of its own.
        labels: names of the bags in the figures; default: the names of the trials.

    Raises:
        BadInput: a bag cannot be read.

    """
    runs = [read_run(bag, label) for bag, label in zip(bags, _labels(bags, labels), strict=True)]
    if len({run.label for run in runs}) < len(runs):
        runs = [run._replace(label=_distinct(run)) for run in runs]
    other = read_run(comparison) if comparison else None
    if other is not None:
        runs[0] = runs[0]._replace(label="with feedforward") if len(runs) == 1 else runs[0]
        other = other._replace(label="without feedforward")
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(render(runs, other), encoding="utf-8")
    return out


def render(runs: Sequence[RunData], other: RunData | None = None) -> str:
    """Return the report of these runs as HTML."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("flexslew_lab.report", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["number"] = number
    first = runs[0]
    shown = [*runs, *([other] if other else [])]
    scenes = [scene for scene in map(scene_of, shown) if scene]
    return environment.get_template("report.html.j2").render(
        title=str(first.trial.get("name", "")) or first.label,
        subtitle=_subtitle(first),
        runs=shown,
        colours=figures.COLOURS,
        headlines=_headlines(first),
        sections=_sections(runs, other),
        scenes=_embedded(scenes) if scenes else "",
        first_look=0.5 * first.metrics["manoeuvre_start"] + 0.5 * first.metrics["manoeuvre_end"],
        metric_rows=_metric_rows(shown),
        provenance=[_provenance(run) for run in shown],
        plotly=get_plotlyjs(),
    )


def number(value: Any) -> str:
    """Return a value of metrics.json for a person."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}" if abs(value) < 1e5 else f"{value:.4e}"
    return str(value)


def _sections(runs: Sequence[RunData], other: RunData | None) -> list[_Section]:
    first, many = runs[0], len(runs) > 1
    sections = [
        _section(
            "The manoeuvre",
            "Joints with their reference, tip deflection, and the efforts that the drives really "
            "applied with the plan's feedforward. The manoeuvre is shaded.",
            [figures.manoeuvre(runs)],
        )
    ]
    if other is not None:
        words = "The same trial flown by feedback alone: what the plan is worth."
        figure = figures.comparison(first, other)
        sections.append(_section("With and without feedforward", words, [figure]))
    per_run: tuple[tuple[str, str, Callable[[RunData], go.Figure | None]], ...] = (
        (
            "Who is in charge",
            "The controller that answers, and by how much the effort jumped when it changed.",
            figures.charge,
        ),
        (
            "Estimate against truth",
            "What the controller in charge believed, minus what was so.",
            figures.estimation,
        ),
        ("Terms of the effort", "What the controller in charge added up.", figures.effort_terms),
    )
    for title, words, draw in per_run:
        drawn = [(run, draw(run)) for run in runs]
        found = [(run, figure) for run, figure in drawn if figure is not None]
        for run, figure in found:
            if many:
                figure.update_layout(title={"text": run.label, "x": 0.5, "font": {"size": 13}})
        if found:
            sections.append(_section(title, words, [figure for _, figure in found]))
    return sections


def _section(title: str, words: str, drawn: list[go.Figure]) -> _Section:
    name = title.lower().replace(" ", "-")
    return _Section(
        title,
        words,
        [_Figure(f"{name}-{k}", _safe(figure.to_json())) for k, figure in enumerate(drawn)],
    )


def _headlines(run: RunData) -> list[tuple[str, str, list[tuple[str, str]]]]:
    """Return (name, unit, [(value, joint)]) for the numbers on top."""
    cards = []
    for key in HEADLINES:
        value, unit = run.metrics[key], _unit(METRICS[key].unit, run)
        named = value.items() if isinstance(value, dict) else [("", value)]
        parts = [(_short(part), str(name)) for name, part in named]
        cards.append((key.replace("_", " "), unit, parts))
    return cards


def _short(value: Any) -> str:
    return f"{value:,.3g}" if isinstance(value, float) and abs(value) < 1e3 else number(value)


def _metric_rows(runs: Sequence[RunData]) -> list[tuple[str, str, str, list[str]]]:
    """Return (key, unit, meaning, one value a run) for every number."""
    rows = []
    for key, metric in METRICS.items():
        unit = _unit(metric.unit, runs[0])
        if not metric.per_joint:
            values = [number(run.metrics[key]) for run in runs]
            rows.append((key, unit, metric.meaning, values))
            continue
        for name in runs[0].joint_names:
            values = [number(run.metrics[key].get(name)) for run in runs]
            rows.append((f"{key}.{name}", unit, metric.meaning, values))
    return rows


def _unit(unit: str, run: RunData) -> str:
    """Return the unit for these joints, where the schema names one for each kind."""
    linear = [kind == "m" for kind in run.joint_units]
    if " or " in unit and len(set(linear)) == 1:
        unit = unit.split(" or ")[1 if linear[0] else 0]
    return "" if unit == "-" else unit


def _subtitle(run: RunData) -> str:
    testbed = run.overview.testbed
    m = run.metrics
    parts = [
        f"{testbed.kind} testbed, {testbed.modes} modes" if testbed else "",
        f"{m['duration']:g} s simulated in {m['ticks']} ticks",
        f"{m['wall_time']:.3g} s on the wall clock" if m["wall_time"] else "",
    ]
    return " · ".join(part for part in parts if part)


def _provenance(run: RunData) -> dict[str, Any]:
    overview = run.overview
    record = overview.metadata.get(TRIAL_RECORD, {})
    plans = [
        {
            "method": plan.method,
            "hash": plan.hash,
            "request": plan.request,
            "summary": plan.summary,
            "versions": plan.versions,
            "words": f"{plan.start:g} s to {plan.start + plan.duration:g} s",
        }
        for plan in overview.plans
    ]
    skipped = ("trial", "checksum")
    facts = {k: v for k, v in record.items() if k not in skipped}
    ended = overview.metadata.get(RUN_RECORD, {})
    facts |= {k: v for k, v in ended.items() if k not in (*skipped, "format")}
    return {
        "label": run.label,
        "trial": record.get("trial", "") or yaml.safe_dump(run.trial),
        "facts": facts,
        "plans": plans,
        "events": overview.events[:EVENTS],
        "more_events": max(len(overview.events) - EVENTS, 0),
        "counts": sorted(overview.counts.items()),
        "types": overview.types,
        "cut": overview.cut,
        "statuses": overview.statuses,
    }


def _labels(bags: Sequence[Path], labels: Sequence[str]) -> list[str]:
    return [*labels, *[""] * (len(bags) - len(labels))][: len(bags)]


def _distinct(run: RunData) -> str:
    folder = run.path.parent
    name = folder.parent.name if folder.name in ("bag", "log") else folder.name
    return f"{run.label} ({name})"


def _embedded(data: Any) -> str:
    return _safe(json.dumps(data, separators=(",", ":"), allow_nan=False))


def _safe(text: str) -> str:
    """Return JSON that may stand inside a script element."""
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")
