"""Recorded measurements fed to a controller: is every number in its answers as recorded?"""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.messages.cdr import decode
from flexslew_lab.log.messages.record_schema import multiple_runs_message
from flexslew_lab.replay.answer_comparison import FIELDS as FIELDS
from flexslew_lab.replay.answer_comparison import AnswerComparison
from flexslew_lab.replay.answer_comparison import Divergence as Divergence
from flexslew_lab.replay.answer_comparison import Row as Row
from flexslew_lab.replay.answer_subject import AnswerSubject, law_subject, program_subject
from flexslew_lab.replay.coverage import missing_part
from flexslew_lab.replay.logged_code import changed_code, reading
from flexslew_lab.replay.logged_controllers import Key, trial_of
from flexslew_lab.replay.program import (
    StartProgram,
    compared_controller,
    program_controller,
    replaced_controller,
    testbed_of,
)
from flexslew_lab.report.panels import Group, Panel, legend, style
from flexslew_lab.report.sections import page_of_sections
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import Measurement
from flexslew_plant.own_code import NO_CODE, Trust

_TEXTS = {"term_names"}  # fields that are no numbers


class AnswerTolerance(NamedTuple):
    """The largest difference of a number that counts as equal: the sum of both."""

    relative: float = 0.0  # of the largest recorded magnitude of the field [-]
    absolute: float = 0.0  # in the unit of the field


EXACT = AnswerTolerance()


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
    program: StartProgram | None = None,
    tolerance: AnswerTolerance = EXACT,
) -> Check:
    """Return how a controller answers the measurements of a log, field by field.

    Args:
        bag: the bag's folder or file.
        controller: its name in the log; empty: see program.compared_controller and, with a program,
            program.replaced_controller.
        law: that stands in for the recorded one, with its own defaults.
        settings: that replace the recorded ones key by key.
        progress: called with the tick and the last tick.
        trust: which classes the log may run.
        program: starts a program that answers in place of a law; its commands are compared.
        tolerance: differences that count as equal.

    Raises:
        Untrusted: the log names code that is not trusted.
        BadInput: the controller is not in the log, or the law cannot be built.
        FlexslewError: the program has ended, or gives no answer that a bench accepts.
    """
    reader = BagReader(bag, trust=trust)
    with reading(reader), ExitStack() as stack:
        if program is None:
            name = compared_controller(reader, controller)
            subject = law_subject(reader, name, law, settings or {})
        else:
            name, fields = replaced_controller(reader, controller), testbed_of(reader)
            subject = program_subject(
                stack.enter_context(program_controller(reader, name, program, fields)), fields
            )
        return _checked(reader, name, subject, tolerance, progress)


def _checked(
    reader: BagReader,
    controller: str,
    subject: AnswerSubject,
    tolerance: AnswerTolerance,
    progress: Callable[[int, int], None],
) -> Check:
    testbed = reader.overview.testbed
    allowed = _allowed(reader, controller, subject, tolerance)
    comparison = AnswerComparison(float(testbed.period), subject.fields, allowed)
    last = reader.overview.counts.get("/measurement", 0)
    question_ticks = _Ticks()
    for topic, kind, _, _, data in reader.messages(("/measurement", subject.topic)):
        message = decode(kind, data)
        key = int(message.epoch), int(message.tick)
        if topic == subject.topic:
            if message.controller == controller:
                comparison.recorded(key, subject.recorded(message))
            continue
        if key < question_ticks.last and not key[1]:
            raise BadInput(multiple_runs_message(*key), reader.path)
        question_ticks.add(key)
        question = _question(message, comparison.period)
        mismatch = question.mismatch(len(testbed.joint_names), len(testbed.appendage_names))
        if mismatch:
            raise BadInput(f"/measurement of tick {question.tick}: {mismatch}", reader.path)
        answer = subject.answer(key, question)
        if answer is not None:
            comparison.ours(key, subject.computed(answer, question.time))
        if message.tick % 1000 == 0:
            progress(int(message.tick), last)
    comparison.finish()
    if not comparison.ticks and not comparison.only_recorded:
        raise BadInput(f"{controller} has not answered in this log", reader.path)
    first = comparison.first
    if first is not None and (reason := subject.reason((first.epoch, first.tick))):
        first = first._replace(ours=reason)
    rows = tuple(field.row() for field in comparison.rows.values())
    curves = {name: field.curve.points() for name, field in comparison.rows.items() if field.ticks}
    return Check(
        controller,
        subject.law,
        first is None,
        comparison.ticks,
        comparison.only_recorded,
        comparison.only_ours,
        first,
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


def _allowed(
    reader: BagReader, controller: str, subject: AnswerSubject, tolerance: AnswerTolerance
) -> dict[str, float]:
    """Return the largest allowed |difference| of each field, in the unit of the field."""
    peaks = dict.fromkeys(subject.fields, 0.0)
    if tolerance.relative:
        for _, kind, _, _, data in reader.messages((subject.topic,)):
            message = decode(kind, data)
            if message.controller != controller:
                continue
            recorded = subject.recorded(message)
            for name in set(peaks) - _TEXTS:
                largest = float(np.abs(recorded[name]).max(initial=0.0))
                peaks[name] = max(peaks[name], largest)
    return {name: tolerance.absolute + tolerance.relative * peak for name, peak in peaks.items()}


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
