"""Writes the topics of an in-process run into a bag, as the recorder does."""

from collections.abc import Callable
from typing import Any

from flexslew_control.controllers import settings_text
from flexslew_control.controllers.controller import Answer, Controller
from flexslew_control.message_fields import plan_fields, state_bytes
from flexslew_control.plan import Plan
from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.messages.cdr import decode, encode
from flexslew_lab.log.recording.bag_writer import BagWriter, RecordingStopped
from flexslew_lab.trial.trial import Trial, bench_settings, law_of
from flexslew_plant.bench.bench import Bench, Truth
from flexslew_plant.bench.message_fields import event_fields, testbed_fields
from flexslew_plant.bench.wire import (
    Stamp,
    command_bytes,
    measurement_bytes,
    stamp_of,
    truth_bytes,
)
from flexslew_plant.events import Event
from flexslew_plant.measurement import Measurement


class BagObserver:
    """Topics of a run, written tick by tick. Implements in_process.Observer.

    A disk that takes no more ends the recording and not the run.

    Args:
        writer: of the bag.
        bare: without measurements and answers, for a flight that others are compared with.
    """

    def __init__(self, writer: BagWriter, bare: bool = False) -> None:
        self._writer, self._bare = writer, bare
        self._now = Stamp(0, 0)
        self.stopped: RecordingStopped | None = None  # why nothing is written any more
        self.written: Callable[[str, bytes], None] | None = None  # takes every message, too

    def describe(self, trial: Trial, bench: Bench) -> Any:
        """Write the testbed; return it as a flexslew_msgs/Testbed."""
        fields = testbed_fields(bench, bench_settings(trial))
        testbed = self.message("/testbed", 0.0, **fields)
        self._put("/testbed", testbed)
        return testbed

    def notify(
        self, trial: Trial, bench: Bench, plan: Plan | None, controllers: dict[str, Controller]
    ) -> None:
        """Write what is latched over ROS: testbed, plan, controllers."""
        self.describe(trial, bench)
        digest = ""
        if plan is not None:
            message = self.message("/plan", 0.0, **plan_fields(plan, bench.model.attitude))
            digest = message.hash
            self.plan(message)
        for name, controller in controllers.items():
            law, law_settings = law_of(name, trial.controllers[name] or {})
            self.status(
                {
                    "controller": name,
                    "law": law,
                    "ready": controller.reason is None,
                    "reason": str(controller.reason or ""),
                    "last_tick": 0,
                    "epoch": bench.epoch,
                    "plan_hash": digest,
                    "settings": settings_text(controller, law, law_settings),
                    "plan_number": int(plan is not None),
                    "plan_epoch": bench.epoch,
                }
            )

    def message(self, topic: str, time: float, **fields: Any) -> Any:
        """Return a message with its fields as attributes, stamped with a simulated time [s]."""
        kind = TOPICS[topic].type
        return decode(kind, encode(kind, {"stamp": stamp_of(time), **fields}))

    def plan(self, message: Any) -> None:
        """Write a flexslew_msgs/Plan."""
        self._put("/plan", message)

    def status(self, fields: dict[str, Any]) -> Any:
        """Write the status of a controller; return it as a flexslew_msgs/ControllerStatus."""
        topic = "/controller_status"
        status = self.message(topic, self._now.sec + self._now.nanosec * 1e-9, **fields)
        self._put(topic, status)
        return status

    def question(self, question: Measurement) -> None:
        """Write a measurement."""
        self._now = stamp_of(question.time)
        if not self._bare:
            self._write("/measurement", measurement_bytes(question))

    def truth(self, truth: Truth) -> None:
        """Write the state at a tick."""
        self._now = stamp_of(truth.time)
        self._write("/truth", truth_bytes(truth))

    def answer(self, answer: Answer) -> None:
        """Write a command and what led to it."""
        if self._bare:
            return
        self._write("/effort_command", command_bytes(answer.command, self._now))
        self._write("/controller_state", state_bytes(answer, self._now))

    def event(self, event: Event) -> None:
        """Write an event."""
        self._put("/events", event_fields(event))

    def close(self) -> None:
        """Make the bag whole.

        Raises:
            RecordingStopped: it is not on the disk.
        """
        self._writer.close({"messages": str(self._writer.messages)})

    def _put(self, topic: str, message: Any) -> None:
        self._write(topic, encode(TOPICS[topic].type, message))

    def _write(self, topic: str, data: bytes) -> None:
        if self.written is not None:
            self.written(topic, data)
        if self.stopped is not None:
            return
        at = self._now.sec * 10**9 + self._now.nanosec
        try:
            self._writer.write(topic, TOPICS[topic].type, data, at)
        except RecordingStopped as error:
            self.stopped = error
