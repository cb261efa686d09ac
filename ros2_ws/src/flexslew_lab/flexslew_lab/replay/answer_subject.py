"""What answers the measurements of a log, and which fields of its answers are compared."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.controllers.controller import Answer
from flexslew_control.message_fields import answer_fields
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.replay.answer_comparison import FIELDS
from flexslew_lab.replay.logged_controllers import Key, LoggedControllers, logged_laws
from flexslew_lab.replay.program import ProgramController
from flexslew_plant.arrays import Vector
from flexslew_plant.bench.wire import stamp_of
from flexslew_plant.measurement import Measurement
from flexslew_plant.own_code import Trust


class AnswerSubject(NamedTuple):
    """What is compared with the log."""

    law: str  # or the command of a program
    topic: str  # of the recorded answers
    fields: tuple[str, ...]  # that are compared
    recorded: Callable[[Any], dict[str, Any]]  # returns the fields of a message of the topic
    answer: Callable[[Key, Measurement], Answer | None]
    computed: Callable[[Answer, float], dict[str, Any]]  # fields of an answer, and its time [s]
    reason: Callable[[Key], str] = lambda _: ""  # why a question has no answer; empty: unknown


def law_subject(
    reader: BagReader, controller: str, law: str | None, settings: Mapping[str, Any]
) -> AnswerSubject:
    """Return a controller of the log with its law, or with another one."""
    recorded_law, values = logged_laws(reader)[controller]
    base_settings = {} if law is not None and law != recorded_law else values
    law_and_settings = law or recorded_law, {**base_settings, **settings}
    word = {law} if law is not None else set()  # the reader's own
    trust = Trust(reader.trust.names | word, reader.trust.trust_all)
    logged = LoggedControllers(reader, controller, {controller: law_and_settings}, trust=trust)

    def answer(key: Key, question: Measurement) -> Answer | None:
        logged.until(key)
        return logged.by_name[controller].observe(question)

    return AnswerSubject(
        law_and_settings[0],
        "/controller_state",
        FIELDS,
        lambda message: {name: getattr(message, name) for name in FIELDS},
        answer,
        lambda answer, _: answer_fields(answer),
    )


def program_subject(program: ProgramController, testbed: Mapping[str, Any]) -> AnswerSubject:
    """Return a program in place of a controller: its commands are compared."""
    efforts = tuple(f"effort[{name}]" for name in testbed["joint_names"])

    def fields(at: Any, effort: Vector) -> dict[str, Any]:
        # an answer of another size was rejected by the bench
        numbers = effort if len(effort) == len(efforts) else np.full(len(efforts), np.nan)
        time = at.sec + 1e-9 * at.nanosec
        return {"stamp": time, "effort": effort, **dict(zip(efforts, numbers, strict=True))}

    return AnswerSubject(
        program.command,
        "/effort_command",
        ("stamp", *efforts),
        lambda message: fields(message.stamp, message.effort),
        lambda _, question: program.observe(question),
        lambda answer, time: fields(stamp_of(time), answer.command.effort),
        program.reason,
    )
