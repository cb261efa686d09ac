"""Recorded measurements fed to a controller: is every number in its answers as recorded?"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.message_fields import answer_fields
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.messages.cdr import decode
from flexslew_lab.log.messages.record_schema import multiple_runs_message
from flexslew_lab.replay.answer_comparison import FIELDS as FIELDS
from flexslew_lab.replay.answer_comparison import AnswerComparison
from flexslew_lab.replay.answer_comparison import Divergence as Divergence
from flexslew_lab.replay.answer_comparison import Row as Row
from flexslew_lab.replay.coverage import missing_part
from flexslew_lab.replay.logged_code import changed_code, reading
from flexslew_lab.replay.logged_controllers import Key, LoggedControllers, logged_laws, trial_of
from flexslew_lab.report.panels import Group, Panel, legend, style
from flexslew_lab.report.sections import page_of_sections
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import Measurement
from flexslew_plant.own_code import NO_CODE, Trust


class Check(NamedTuple):
    """A controller compared with its log."""

    controller: str
    law: str
    ok: bool  # every number is equal, no recorded answer is missing
    ticks: int  # compared
    only_recorded: int  # ticks that only the log answers
    only_ours: int  # ticks with an answer here only: the recorded one was lost
    first_divergence: Divergence | None
    missing: str  # which part of the run was compared, and why not all of it; empty: all of it
    changed_code: dict[str, tuple[str, str]]  # class: SHA-256 of its file there, here
    rows: tuple[Row, ...]
    curves: dict[str, tuple[np.ndarray, np.ndarray]]  # field: time [s], largest |difference|


def check(
    bag: Path,
    controller: str,
    law: str | None = None,
    settings: Mapping[str, Any] | None = None,
    progress: Callable[[int, int], None] = lambda tick, last: None,
    trust: Trust = NO_CODE,
) -> Check:
    """Return how a controller answers the measurements of a log, field by field.

    Args:
        bag: the bag's folder or file.
        controller: its name in the log.
        law: that stands in for the recorded one, with its own defaults.
        settings: that replace the recorded ones key by key.
        progress: called with the tick and the last tick.
        trust: which classes the log may run.

    Raises:
        Untrusted: the log names code that is not trusted.
        BadInput: the controller is not in the log, or the law cannot be built.
    """
    reader = BagReader(bag, trust=trust)
    with reading(reader):
        return _checked(reader, controller, law, settings or {}, progress)


def _checked(
    reader: BagReader,
    controller: str,
    law: str | None,
    settings: Mapping[str, Any],
    progress: Callable[[int, int], None],
) -> Check:
    laws = logged_laws(reader)
    if controller not in laws:
        raise BadInput(f"no controller {controller}; it has {', '.join(laws)}", reader.path)
    recorded_law, values = laws[controller]
    base_settings = {} if law is not None and law != recorded_law else values
    law_and_settings = law or recorded_law, {**base_settings, **settings}
    word = {law} if law is not None else set()  # the reader's own
    trust = Trust(reader.trust.names | word, reader.trust.trust_all)
    logged = LoggedControllers(reader, controller, {controller: law_and_settings}, trust=trust)
    testbed = reader.overview.testbed
    comparison = AnswerComparison(float(testbed.period))
    last = reader.overview.counts.get("/measurement", 0)
    question_ticks = _Ticks()
    for topic, kind, _, _, data in reader.messages(("/measurement", "/controller_state")):
        message = decode(kind, data)
        key = int(message.epoch), int(message.tick)
        if topic == "/controller_state":
            if message.controller == controller:
                comparison.recorded(key, {name: getattr(message, name) for name in FIELDS})
            continue
        if key < question_ticks.last and not key[1]:
            raise BadInput(multiple_runs_message(*key), reader.path)
        question_ticks.add(key)
        logged.until(key)
        question = _question(message, comparison.period)
        mismatch = question.mismatch(len(testbed.joint_names), len(testbed.appendage_names))
        if mismatch:
            raise BadInput(f"/measurement of tick {question.tick}: {mismatch}", reader.path)
        answer = logged.by_name[controller].observe(question)
        if answer is not None:
            comparison.ours(key, answer_fields(answer))
        if message.tick % 1000 == 0:
            progress(int(message.tick), last)
    comparison.finish()
    if not comparison.ticks and not comparison.only_recorded:
        raise BadInput(f"{controller} has not answered in this log", reader.path)
    rows = tuple(comparison.rows[name].row() for name in FIELDS)
    curves = {n: comparison.rows[n].curve.points() for n in FIELDS if comparison.rows[n].ticks}
    return Check(
        controller,
        law_and_settings[0],
        comparison.first is None,
        comparison.ticks,
        comparison.only_recorded,
        comparison.only_ours,
        comparison.first,
        missing_part(
            reader,
            trial_of(reader),
            question_ticks.first,
            question_ticks.last[1],
            question_ticks.gaps,
        ),
        changed_code(reader),
        rows,
        curves,
    )


class _Ticks:
    """The ticks of the measurements, of which a log may lack some."""

    def __init__(self) -> None:
        self.first, self.last, self.gaps = 0, (-1, -1), 0

    def add(self, key: Key) -> None:
        """Take epoch and tick of a measurement."""
        if key[0] > self.last[0]:
            self.first, self.last = key[1], key
        elif key > self.last:
            self.gaps += key[1] - self.last[1] - 1
            self.last = key


def difference_page(result: Check) -> str:
    """Return the largest difference of every field over time, as a page."""
    panel = Panel("difference, in the unit of the field", log=True, x_title="time [s]", height=420)
    different = {name: curve for name, curve in result.curves.items() if curve[1].any()}
    for number, (name, (time, value)) in enumerate(different.items()):
        panel.line(time, np.where(value > 0.0, value, np.nan), name, style(number))
    title = f"{result.controller} ({result.law}): |recorded - here|"
    group = Group(title, "" if different else "No difference.", [panel], legend([*different]))
    return page_of_sections("check", title, "", [group])


def _question(m: Any, period: float) -> Measurement:
    return Measurement(
        int(m.tick),
        int(m.epoch),
        int(m.tick) * period,
        m.controller,
        m.joint_position,
        m.joint_velocity,
        m.tip_deflection,
        m.root_curvature,
        m.applied_effort,
    )
