"""report.html: one file with everything in it, made from bags alone."""

import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from flexslew_control.plan import Plan
from flexslew_lab.log.bag_layout import RUN_RECORD, TRIAL_RECORD
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.metrics import KEYS
from flexslew_lab.metrics.goal import goal_error_message
from flexslew_lab.metrics.operator_changes import changes_of
from flexslew_lab.metrics.rows import flat, key_of, row_unit, unit_of
from flexslew_lab.report import figures
from flexslew_lab.report.page import embedded, render, write_page
from flexslew_lab.report.panels import COLOURS, LIGHT, Group
from flexslew_lab.report.run_data import RunData, read_run
from flexslew_lab.report.scene_data import scene_of
from flexslew_lab.report.sections import Table, page_of_sections
from flexslew_lab.report.sky_map import testbed_sky_map
from flexslew_lab.report.story import Line, story_of
from flexslew_lab.report.thumbnail import THUMBNAIL, thumbnail
from flexslew_lab.report.verdict import joints_to_move, model_difference, plan_verdict, run_summary
from flexslew_lab.short_values import short
from flexslew_lab.trial.outputs import WITHOUT
from flexslew_lab.trial.trial import Trial
from flexslew_plant.counted import count_text
from flexslew_plant.events import IN_CHARGE, FastMode, LargeDeflection, SwitchCompleted, step_words
from flexslew_plant.yaml_data import load_yaml

REPORT = "report.html"  # of a run, in its folder, with its thumbnail beside it
EVENTS = 300  # of a run that the table shows
KEY_METRICS = (
    "residual_tip_deflection",
    "residual_attitude_error",
    "settling_time",
    "peak_effort",
    "control_effort",
    "missed_ticks",
)


_Row = tuple[str, str, str, list[str]]  # key, unit, meaning, one value per run


class _Story(NamedTuple):
    """What an operator did to a run, for its section."""

    label: str
    lines: list[Line]


class _KeyMetrics(NamedTuple):
    """The numbers on top of a report."""

    label: str
    cards: list[tuple[str, str, list[tuple[str, str]]]]  # (name, unit, [(value, joint)])


def write_report(
    bags: Sequence[Path | BagReader],
    out: Path,
    comparison: Path | BagReader | RunData | None = None,
) -> Path:
    """Return the path of the report that was written.

    Args:
        bags: the run, by path or open; with more than one they are overlaid, the first one leads.
        out: the HTML file.
        comparison: a bag of the same trial without feedforward, for a comparison of its own; left
            out where an operator changed the run.

    Raises:
        BadInput: a bag cannot be read.

    """
    runs = [read_run(bag) for bag in bags]
    if len({run.label for run in runs}) < len(runs):
        runs = [run._replace(label=_distinct(run)) for run in runs]
    for k, run in enumerate(runs):  # the same run twice
        if run.label in [other.label for other in runs[:k]]:
            runs[k] = run._replace(label=f"{run.label} no. {k + 1}")
    if len(runs) == 1 and changes_of(runs[0].overview.events):
        comparison = None  # flown without what the operator did
    other = (
        comparison
        if comparison is None or isinstance(comparison, RunData)
        else (read_run(comparison))
    )
    if other is not None:
        runs[0] = runs[0]._replace(label="with feedforward") if len(runs) == 1 else runs[0]
        other = other._replace(label="without feedforward")
    if len(runs) == 1 and out.name == REPORT:
        write_page(thumbnail(runs[0]), out.with_name(THUMBNAIL))
    return write_page(page_of(runs, other), out)


def write_plan(
    plan: Plan,
    units: Sequence[str],
    limits: Sequence[float],
    rows: Sequence[tuple[str, str]],
    out: Path,
) -> Path:
    """Return the page that was written: a plan's reference and feedforward with their units.

    Args:
        plan: what to draw.
        units: of the joints, rad or m.
        limits: of the drives, one per joint [N m or N].
        rows: numbers below the figure, (name, value).
        out: the HTML file.
    """
    goal = ", ".join(
        f"{name} {position:.4g} {unit}"
        for name, position, unit in zip(plan.joint_names, plan.position[-1], units, strict=True)
    )
    sections = (figures.plan_profile(plan, units, limits), Table("Numbers", "", (), rows))
    words = plan_verdict(plan, limits)
    return write_page(page_of_sections("plan", plan.method, f"to {goal}", sections, words), out)


def page_of(runs: Sequence[RunData], other: RunData | None = None) -> str:
    """Return the report of these runs as HTML."""
    first = runs[0]
    all_runs = [*runs, *([other] if other else [])]
    scenes = [scene for scene in map(scene_of, all_runs) if scene]
    names = dict.fromkeys(str(run.trial.get("name", "")) or run.label for run in runs)
    groups = list(_groups(runs, other))
    main_rows, other_rows = _metric_rows(all_runs)
    return render(
        "report.html.j2",
        title=", ".join(names),
        verdicts=[(run.label, _run_summary(run, other)) for run in runs],
        stories=[
            _Story(run.label, story_of(run.overview.events[:EVENTS]))
            for run in runs
            if changes_of(run.overview.events)
        ],
        repeats=[_repeat(run) for run in runs],
        subtitle=_subtitle(first) if len(runs) == 1 else f"{len(runs)} runs, overlaid",
        runs=all_runs,
        compared=other is not None,
        colours=COLOURS,
        headlines=[_KeyMetrics(run.label, _key_metrics(run)) for run in all_runs],
        groups=groups,
        charges=[_charge(run) for run in runs if len(run.phases) > 1],
        skies=[
            (run.label, sky)
            for run in all_runs
            if (sky := testbed_sky_map(run.testbed, run.frame_position, run.frame_reference))
        ],
        scenes=embedded(scenes) if scenes else "",
        aims=any(scene["aims"] for scene in scenes),
        first_look=0.5 * first.metrics["manoeuvre_start"] + 0.5 * first.metrics["manoeuvre_end"],
        metric_rows=main_rows,
        still_rows=other_rows,
        provenance=[_provenance(run) for run in all_runs],
    )


def number(value: Any) -> str:
    """Return a value of metrics.json for a person."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return short(value, 4)


def _groups(runs: Sequence[RunData], other: RunData | None) -> Iterator[Group]:
    """Yield the groups of panels that have something to show."""
    yield figures.manoeuvre(runs)
    all_runs = [*runs, *([other] if other else [])]
    left = figures.residual(all_runs)
    if left is not None:
        yield left
    if other is not None:
        yield figures.feedforward_comparison([runs[0], other])
    modes = figures.modes(runs)
    if modes is not None:
        yield modes
    for draw in (
        figures.platform,
        figures.momentum,
        figures.jitter,
        figures.estimation,
        figures.effort_terms,
    ):
        for number, run in enumerate(runs):
            group = draw(run)
            if group is None:
                continue
            if len(runs) > 1:
                group.title += f": {run.label}"
                group.key = f"{draw.__name__}-{number}"
            yield group


def _run_summary(run: RunData, other: RunData | None) -> str:
    """Return the sentence on top of a report."""
    tolerance = run.trial.get("goal_tolerance", Trial.goal_tolerance)
    bare = other.metrics if other is not None else {}
    changes = len(changes_of(run.overview.events))
    return run_summary(run.metrics, bare, tolerance, changes, run.units)


def _repeat(run: RunData) -> tuple[str, str, str]:
    """Return the name of a run, where it is flown again from, and the command for that."""
    folder = folder_of(run.path)
    if changes_of(run.overview.events) or not (folder / "trial.yaml").is_file():
        where = "From its log, with what an operator did, to the same bits"
        return run.label, where, shlex.join(["./flexslew", "resim", str(folder)])
    return (
        run.label,
        "From its trial",
        shlex.join(["./flexslew", "trial", str(folder / "trial.yaml")]),
    )


def _charge(run: RunData) -> dict[str, Any]:
    """Return the active controller of each phase, how it took charge, and the effort step."""
    names = list(dict.fromkeys(phase.controller for phase in run.phases if phase.controller))
    changes = [e for e in run.overview.events if isinstance(e.what, IN_CHARGE)]
    total = max(run.phases[-1].end - run.phases[0].start, 1e-9)
    phases = []
    for number, phase in enumerate(run.phases):
        before = [e for e in changes if abs(e.time - phase.start) < 1e-6 or e.time < phase.start]
        event = before[-1] if before and number else None
        step = event.what.effort_step if event and isinstance(event.what, SwitchCompleted) else None
        known = phase.controller in names
        phases.append(
            {
                "name": phase.controller or "the drive's brake",
                "start": phase.start,
                "end": phase.end,
                "share": f"{(phase.end - phase.start) / total:.6f}",
                "colour": COLOURS[names.index(phase.controller) % len(COLOURS)] if known else LIGHT,
                "how": event.kind if event is not None else "from the start",
                "step": "" if step is None else step_words(step),
            }
        )
    return {"label": run.label, "phases": phases, "unit": unit_of("peak_effort", run.joint_units)}


def _key_metrics(run: RunData) -> list[tuple[str, str, list[tuple[str, str]]]]:
    """Return (name, unit, [(value, joint)]) for the numbers on top, of the joints that move."""
    entries = []
    tolerance = run.trial.get("goal_tolerance", Trial.goal_tolerance)
    error_keys = (
        ("goal_error", "final_error") if goal_error_message(run.metrics, tolerance, {}) else ()
    )
    units = run.units
    active_joints = [name for name in units if name in joints_to_move(run.metrics)]
    for key in (*error_keys, *KEY_METRICS):
        value, named = run.metrics[key], {"": run.metrics[key]}
        if isinstance(value, dict):
            named = {name: value[name] for name in active_joints if name in value} or value
        unit = unit_of(key, {units[name] for name in named if name in units} or units.values())
        entries.append(
            (
                key.replace("_", " "),
                unit,
                [(number(part), str(name)) for name, part in named.items()],
            )
        )
    return entries


def _metric_rows(runs: Sequence[RunData]) -> tuple[list[_Row], list[_Row]]:
    """Return a row for every number, with those of joints without a commanded move separate."""
    each = [flat(run.metrics) for run in runs]
    order = {name: k for k, name in enumerate(runs[0].joint_names)}
    names = sorted(
        {name: None for rows in each for name in rows},
        key=lambda name: (_place(name), order.get(name.partition(".")[2], len(order))),
    )
    active_joints = {name for run in runs for name in joints_to_move(run.metrics)}
    rest_joints = {name for run in runs for name in run.joint_names} - active_joints
    user_keys = {key: entry for run in runs for key, entry in run.user_keys.items()}
    found: tuple[list[_Row], list[_Row]] = ([], [])
    for name in names:
        values = [number(rows.get(name)) for rows in each]
        unit, description = (
            row_unit(name, runs[0].units, user_keys),
            key_of(name, user_keys).meaning,
        )
        found[name.partition(".")[2] in rest_joints].append((name, unit, description, values))
    return found


def _place(name: str) -> int:
    """Return where a row stands: in the order of the keys, what is not the bench's own last."""
    key = name.split(".")[0]
    return list(KEYS).index(key) if key in KEYS else len(KEYS)


def _subtitle(run: RunData) -> str:
    testbed = run.overview.testbed
    m = run.metrics
    plans = run.overview.plans
    believed = model_difference(load_yaml(plans[-1].summary, "plan")) if plans else ""
    parts = [
        believed[:1].upper() + believed[1:],
        f"{testbed.kind} testbed, {count_text(testbed.modes, 'mode')}" if testbed else "",
        f"{m['duration']:g} s simulated in {count_text(m['ticks'], 'tick')}",
        f"{m['wall_time']:.3g} s on the wall clock" if m["wall_time"] else "",
    ]
    return " · ".join(part for part in parts if part)


def _provenance(run: RunData) -> dict[str, Any]:
    overview = run.overview
    record = overview.metadata.get(TRIAL_RECORD, {})
    plan_rows = [
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
    run_record = overview.metadata.get(RUN_RECORD, {})
    facts |= {k: v for k, v in run_record.items() if k not in (*skipped, "format")}
    return {
        "label": run.label,
        "trial": record.get("trial", "") or yaml.safe_dump(run.trial),
        "facts": facts,
        "plans": plan_rows,
        "events": overview.events[:EVENTS],
        "doubtful": [
            event.message
            for event in overview.events
            if isinstance(event.what, LargeDeflection | FastMode)
        ],
        "more_events": max(len(overview.events) - EVENTS, 0),
        "counts": sorted(overview.counts.items()),
        "types": overview.types,
        "cut": overview.cut,
        "statuses": overview.statuses,
    }


def folder_of(bag: Path) -> Path:
    """Return the run folder that contains a bag, or its file."""
    folder = bag.parent if bag.is_file() else bag
    return folder.parent if folder.name in ("bag", "log", WITHOUT) else folder


def _distinct(run: RunData) -> str:
    return f"{run.label} ({folder_of(run.path).name})"
