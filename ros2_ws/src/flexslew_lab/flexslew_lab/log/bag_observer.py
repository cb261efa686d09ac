"""Writes what an in-process run would say on the topics into a bag, as the recorder does."""

import json
from typing import Any

import numpy as np

from flexslew_control.controllers import settings_text
from flexslew_control.controllers.controller import Answer, Controller
from flexslew_control.plan import Plan
from flexslew_control.plan_file import plan_hash
from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.bag_writer import BagWriter
from flexslew_lab.log.cdr import encode
from flexslew_lab.trial.trial import Trial, bench_settings, law_of
from flexslew_plant.bench.bench import Bench, Truth
from flexslew_plant.bench.events import Event
from flexslew_plant.bench.measurement import Measurement
from flexslew_plant.bench.wire import stamp_of
from flexslew_plant.settings import plain, yaml_text


class BagObserver:
    """Topics of a run, written tick by tick. Fulfils in_process.Observer."""

    def __init__(self, writer: BagWriter) -> None:
        self._writer = writer
        self._now: dict[str, int] = {"sec": 0, "nanosec": 0}

    def announce(
        self, trial: Trial, bench: Bench, plan: Plan | None, controllers: dict[str, Controller]
    ) -> None:
        """Write what is latched over ROS: testbed, plan, controllers."""
        self._put(
            "/testbed",
            stamp=self._now,
            kind=trial.testbed.kind,
            joint_names=list(bench.model.joint_names),
            joint_units=list(bench.model.joint_units),
            appendage_names=list(bench.appendages.names),
            modes=bench.model.modes,
            period=trial.period,
            effort_limit=bench.limit,
            settings=yaml_text(plain(bench_settings(trial))),
        )
        digest = plan_hash(plan) if plan is not None else ""
        if plan is not None:
            self._put(
                "/plan",
                stamp=self._now,
                method=plan.method,
                hash=digest,
                joint_names=list(plan.joint_names),
                start=plan.start,
                duration=plan.duration,
                period=plan.period,
                position=plan.position.ravel(),
                velocity=plan.velocity.ravel(),
                effort=plan.effort.ravel(),
                state=plan.state.ravel(),
                request=yaml_text(plan.request),
                summary=yaml_text(plan.summary),
                versions=yaml_text(plan.versions),
            )
        for name, controller in controllers.items():
            law, own = law_of(name, trial.controllers[name] or {})
            self._put(
                "/controller_status",
                stamp=self._now,
                controller=name,
                law=law,
                ready=not controller.reason,
                reason=controller.reason,
                last_tick=0,
                epoch=bench.epoch,
                plan_hash=digest,
                settings=settings_text(controller, law, own),
            )

    def question(self, question: Measurement) -> None:
        """Write a measurement."""
        self._now = stamp_of(question.time)._asdict()
        values = question._asdict()
        del values["time"]
        self._put("/measurement", header=self._header(), **values)

    def truth(self, truth: Truth) -> None:
        """Write the state at a tick."""
        values = truth._asdict()
        self._now = stamp_of(values.pop("time"))._asdict()
        self._put("/truth", header=self._header(), **values)

    def answer(self, answer: Answer) -> None:
        """Write a command and what led to it."""
        command, reference, estimate = answer.command, answer.reference, answer.estimate
        self._put("/effort_command", stamp=self._now, **command._asdict())
        self._put(
            "/controller_state",
            header=self._header(),
            tick=command.tick,
            epoch=command.epoch,
            controller=command.controller,
            reference_position=reference.position,
            reference_velocity=reference.velocity,
            feedforward=reference.effort,
            estimate_position=estimate.position,
            estimate_velocity=estimate.velocity,
            estimate_disturbance=estimate.disturbance,
            covariance_diagonal=np.diagonal(estimate.covariance),
            innovation=estimate.innovation,
            nis=estimate.nis,
            effort=command.effort,
            term_names=list(answer.terms),
            terms=np.concatenate([*answer.terms.values(), np.zeros(0)]),
        )

    def event(self, event: Event) -> None:
        """Write an event."""
        values = event._asdict() | {"level": int(event.level), "data": json.dumps(event.data)}
        at = stamp_of(values.pop("time"))._asdict()
        self._put("/events", stamp=at, **values)

    def _header(self) -> dict[str, Any]:
        return {"stamp": self._now, "frame_id": ""}

    def _put(self, topic: str, **message: Any) -> None:
        kind = TOPICS[topic].type
        at = self._now["sec"] * 10**9 + self._now["nanosec"]
        self._writer.write(topic, kind, encode(kind, message), at)
