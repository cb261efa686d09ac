"""The page's view of a bench: its state now, controllers, events, and the curves of its run."""

from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.law import plant_description
from flexslew_lab.console.history import Track
from flexslew_lab.identification.records.measurements import FIELDS
from flexslew_lab.log.bag_columns import blocks_of
from flexslew_lab.log.files.mcap_scan import RawMessage
from flexslew_lab.log.joints_flown import joints_and_modes
from flexslew_lab.log.messages import cdr
from flexslew_lab.log.messages.logged_event import logged_event
from flexslew_lab.log.messages.record_schema import RECORDS, check_record
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.events import (
    BrakeLatched,
    BrakeReleased,
    BrakeRequested,
    Event,
    RunFinished,
    SwitchCompleted,
    SwitchDropped,
    SwitchRejected,
    SwitchRequested,
    WasReset,
)
from flexslew_plant.graph import topics
from flexslew_plant.own_code import NO_CODE, Trust
from flexslew_plant.testbeds import Testbed, initial_state
from flexslew_plant.testbeds.model import Model

EVENTS = 2000  # that are kept

COORDINATES = "coordinates"  # of the state; positions and velocities are those of joints and modes
_TRUTH = ("position", "velocity", "applied_effort", "tip_deflection", "disturbance")
_CONTROLLER_STATE = ("reference_position", "reference_velocity", "estimate_position", "innovation")
_ROWS = {  # fields of what comes with every tick
    topics.TRUTH: _TRUTH,
    topics.CONTROLLER_STATE: _CONTROLLER_STATE,
    topics.MEASUREMENT: FIELDS,
}


class Now(NamedTuple):
    """State of the bench."""

    state: str = "not found"  # or waiting, running, paused, finished; replaying
    waiting_for: tuple[str, ...] = ()
    tick: int = 0
    last_tick: int = 0  # 0: no end is set
    epoch: int = 0
    rate_factor: float = 0.0
    wall_time: float = 0.0  # [s]
    active: str = ""
    brake_latched: bool = False
    missed_ticks: int = 0
    faults: tuple[tuple[int, str], ...] = ()  # number and words of what disturbs or breaks


class ControllerView(NamedTuple):
    """A controller as it announced itself."""

    name: str
    law: str
    ready: bool
    reason: str
    settings: str  # YAML


class Joints(NamedTuple):
    """What stands on the bench, as far as charts and forms ask."""

    kind: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    appendages: tuple[str, ...]
    limit: tuple[float, ...]  # [N m or N]
    period: float  # [s]

    @property
    def effort_units(self) -> tuple[str, ...]:
        """One per joint."""
        return tuple("N" if unit == "m" else "N m" for unit in self.units)


class BenchView:
    """Takes the messages of a bench, live or recorded.

    Args:
        trust: which testbeds of the user's own may be loaded, to be drawn.
    """

    def __init__(self, trust: Trust = NO_CODE) -> None:
        self.trust = trust
        self.now = Now()
        self.joints: Joints | None = None
        self.testbed: Testbed | None = None  # None also where it may not be loaded
        self.model: Model | None = None  # of the testbed
        self.bench_settings = ""  # as it announced them, YAML
        self.controllers: dict[str, ControllerView] = {}
        self.events: deque[Event] = deque(maxlen=EVENTS)
        self.received = 0  # rises whenever other events are kept than before
        self.plan: Any = None  # the last flexslew_msgs/Plan
        self.truth, self.controller_state = Track(), Track()
        self.measured = Track()  # empty unless the link listens to the sensors
        self.position: Vector = np.zeros(0)  # the coordinates now; empty before the first tick
        self.time = 0.0  # simulated [s]
        self.answering = ""  # controller of the last answer
        self.brake_request: BrakeRequested | None = None  # that acts from a later tick on
        self.switch_request: SwitchRequested | None = None

    @property
    def brake_on_next(self) -> bool:
        """Whether the brake is latched at the next tick, which a paused bench has not reached."""
        return self.brake_request.on if self.brake_request else self.now.brake_latched

    def take(self, name: str, kind: str, data: Sequence[bytes]) -> None:
        """Take messages of one topic in their order.

        Args:
            name: a key of topics.TOPICS.
            kind: its type.
            data: CDR of each.
        """
        if name in _ROWS:
            self._take_rows(name, kind, data)
            return
        for one in data:
            with suppress(BadInput):  # no message of a bench's node; no log holds it
                self._take_one(name, cdr.decode(kind, one))

    def _take_one(self, name: str, message: Any) -> None:
        if f"/{name}" in RECORDS:
            check_record(f"/{name}", message, "the bench")
        if name == topics.BENCH_STATE:
            self._take_state(message)
        elif name == topics.TESTBED:
            self._take_testbed(message)
        elif name == topics.EVENTS:
            self._take_event(message)
        elif name == topics.CONTROLLER_STATUS:
            self.controllers[message.controller] = ControllerView(
                message.controller, message.law, message.ready, message.reason, message.settings
            )
        elif name == topics.PLAN:
            self.plan = message

    def clear(self) -> None:
        """Start again with empty tracks, as after a jump in a log or with another plant."""
        self.truth.clear()
        self.controller_state.clear()
        self.measured.clear()
        self.events.clear()
        self.received += 1
        self.plan, self.position, self.time = None, np.zeros(0), 0.0
        self.brake_request = self.switch_request = None

    def _take_rows(self, name: str, kind: str, data: Sequence[bytes]) -> None:
        raw = [RawMessage(0, 0, 0, one) for one in data]
        tracks = {topics.TRUTH: self.truth, topics.CONTROLLER_STATE: self.controller_state}
        track = tracks.get(name, self.measured)
        for block in blocks_of(name, kind, raw):
            columns = block.columns
            time = columns["header.stamp.sec"] + columns["header.stamp.nanosec"] * 1e-9
            last = track.time[-1] if track.time.size else np.nan
            new = np.diff(time, prepend=last) != 0.0  # a query repeats until answered
            if not new.any():
                continue
            time, columns = time[new], {k: v[new] for k, v in columns.items()}
            increasing = np.concatenate(([True], np.diff(time) > 0.0))
            if not increasing.all():  # a reset within the batch: only what came after it
                first = int(np.flatnonzero(~increasing)[-1])
                time, columns = time[first:], {k: v[first:] for k, v in columns.items()}
            rows = {field: columns[field] for field in _ROWS[name]}
            if name == topics.TRUTH:
                rows |= self._joints_of(rows)
                if int(columns["epoch"][-1]) >= self.now.epoch:  # else of before a reset
                    self.time, self.position = float(time[-1]), columns["position"][-1]
            track.add(time, rows)
            if name == topics.CONTROLLER_STATE:
                self.answering = str(columns["controller"][-1])

    def _joints_of(self, truth: dict[str, Any]) -> dict[str, Any]:
        """Return where joints and modes are, and the coordinates of the state."""
        q = truth["position"]
        place, rate = joints_and_modes(self.model, q, truth["velocity"])
        return {"position": place, "velocity": rate, COORDINATES: q}

    def _take_state(self, m: Any) -> None:
        if m.epoch > self.now.epoch:  # back at the start, no query yet
            self.position = np.zeros(0)
        faults = tuple(zip((int(n) for n in m.fault_numbers), m.faults, strict=False))
        self.now = Now(
            m.state, tuple(m.waiting_for), m.tick, m.last_tick, m.epoch, m.rate_factor,
            m.wall_time, m.active, m.brake_latched, m.missed_ticks, faults,
        )  # fmt: skip
        if m.tick == 0:
            self.time = 0.0

    def _take_testbed(self, m: Any) -> None:
        self.joints = Joints(
            m.kind, tuple(m.joint_names), tuple(m.joint_units), tuple(m.appendage_names),
            tuple(float(limit) for limit in m.effort_limit), m.period,
        )  # fmt: skip
        self.bench_settings = m.settings
        try:
            testbed = plant_description(m.settings, "the bench", self.trust).testbed
        except BadInput:
            self.testbed = self.model = None
            return
        self.testbed, self.model = testbed, testbed.model()
        self.model.joint_states(initial_state(testbed)[None])  # compiled before the start

    def _take_event(self, m: Any) -> None:
        event = logged_event(m, "the bench")
        self.events.append(event)
        self.received += 1
        what, brake = event.what, self.brake_request
        if isinstance(what, BrakeRequested):
            self.brake_request = what
        elif isinstance(what, BrakeLatched | BrakeReleased):
            done = brake is None or brake.on == isinstance(what, BrakeLatched)
            self.brake_request = None if done else brake
        elif isinstance(what, SwitchRequested):
            self.switch_request = what
        elif isinstance(what, SwitchCompleted | SwitchDropped | SwitchRejected | WasReset):
            self.switch_request = None
        elif isinstance(what, RunFinished):  # the plant may leave before it shows its state again
            self.now = self.now._replace(state="finished", tick=event.tick)
