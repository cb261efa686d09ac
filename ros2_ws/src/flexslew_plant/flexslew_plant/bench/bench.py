"""The bench without ROS: the testbed, its motors, sensors and drive, tick by tick.

One tick is one question and one answer: read `question`, `offer` commands until one is taken,
then `advance`. Advancing without an answer is a missed tick.
"""

from collections import deque
from collections.abc import Sequence
from typing import Any

import numpy as np

from flexslew_plant.arrays import Vector, keep_all, read_only
from flexslew_plant.bench.divergence import diagnosis, integration_of, is_lost
from flexslew_plant.bench.due_ticks import past, too_late
from flexslew_plant.bench.handover import RUN_OVER, Handover
from flexslew_plant.bench.injections import Injections, injection_of, injections_of, names_of
from flexslew_plant.bench.records import ActiveFault
from flexslew_plant.bench.records import BenchSettings as BenchSettings
from flexslew_plant.bench.records import SwitchRequest as SwitchRequest
from flexslew_plant.bench.records import SwitchResult as SwitchResult
from flexslew_plant.bench.records import Truth as Truth
from flexslew_plant.bench.retarget import requested_target, with_schedule, with_target
from flexslew_plant.bench.schedule import requested_entry, require_allowed
from flexslew_plant.errors import BadInput
from flexslew_plant.events import (
    CommandRejected,
    Event,
    Fact,
    FaultEndRequested,
    InjectionRequested,
    LargeDeflection,
    PlantLost,
    RunFinished,
    StateLost,
    TargetRequested,
    event_of,
    is_reported,
    message_of,
)
from flexslew_plant.events.run import RejectionReason
from flexslew_plant.external.messages import PlantFault
from flexslew_plant.faults.dispatch import load_steps
from flexslew_plant.faults.effects import CommandStatus
from flexslew_plant.hardware.actuator import Actuator, minimum_impulse
from flexslew_plant.hardware.drive import Drive
from flexslew_plant.hardware.friction import friction_of
from flexslew_plant.hardware.plausibility import Plausibility
from flexslew_plant.hardware.sensors import Readings, Sensors, exact_readings
from flexslew_plant.hardware.spin_limits import spin_limits_of
from flexslew_plant.measurement import EffortCommand, Measurement
from flexslew_plant.refusal import Cause, Refusal, Reply
from flexslew_plant.testbeds import Testbed, initial_state
from flexslew_plant.testbeds.contract import BlackBox, RunningPlant, has_own_clock
from flexslew_plant.testbeds.model import Model

_RIGID_FREQUENCY = 0.1  # of the brake on what has no mode [rad/s]
_FLOAT = np.dtype(np.float64)  # the one of all arrays of this kind


def _initial_model(given: Testbed, testbed: Testbed) -> tuple[Vector, Model, float]:
    """Return the state in which a testbed begins, its model and its slowest frequency [rad/s].

    Args:
        given: the trial's.
        testbed: the same with the turns of the schedule.

    Raises:
        BadInput: its numbers are too large or too small to compute with.
    """
    try:
        start, model = read_only(initial_state(given)), testbed.model()
        if not model.has_equations:
            return start, model, _RIGID_FREQUENCY
        small = model.linearise(model.split(start)[0])
        if not np.isfinite((small.mass, small.stiffness)).all():
            raise OverflowError("mass and stiffness are not finite")
        return start, model, min(small.frequencies, default=_RIGID_FREQUENCY)
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        raise BadInput(f"its numbers are out of range ({error})", key="testbed") from None


def _numbers(effort: Any) -> Vector:
    """Return efforts that a person gave as a list, or in another precision."""
    try:
        given = np.asarray(effort)
    except ValueError:  # [[1], [2, 3]]
        given = np.asarray(None)
    if given.dtype.kind not in "iuf":
        raise BadInput("give an array of numbers, one per joint", key="effort", value=effort)
    return given.astype(np.float64)


class Bench:
    """The tick machine.

    Args:
        settings: a trial's plant.

    Raises:
        BadInput: a schedule entry names what the testbed does not have, or breaks something
            although faults are off; what has no motors shall have friction; the testbed's
            numbers are out of range; or the period is too long for its fastest mode.
    """

    question: Measurement  # of this tick

    def __init__(self, settings: BenchSettings) -> None:
        self.settings = settings
        self._testbed = with_schedule(settings.testbed, settings.schedule)
        self._start, self.model, lowest_frequency = _initial_model(settings.testbed, self._testbed)
        self.appendages = self.model.appendages
        self.limit: Vector = np.array(settings.testbed.effort_limit, dtype=float)
        self._plant: RunningPlant | None = None  # of a black box, while it runs
        brake = self._brake_damping(lowest_frequency)
        self.drive = Drive(settings.active, settings.max_missed, brake)
        self._ends_under_brake = self.own_clock and not brake.any()
        self.handover = Handover(self.drive, settings.fallback, self.tell)
        motors, names, period = settings.actuator, self.model.joint_names, settings.period
        impulse = minimum_impulse(motors, names, self.limit, period)
        self.actuator = Actuator(motors, self.limit, period, impulse, self.model.one_way)
        self._wheel_limits = spin_limits_of(self.model, settings.period)
        check_settings = settings.plausibility
        self._sensor_check = (
            Plausibility(check_settings, settings.period) if check_settings else None
        )
        q, _ = self.model.split(self._start)
        self._steps, self.fast_mode = integration_of(
            self.model, q, settings.period, settings.duration, settings.integration_steps
        )
        self._friction = friction_of(settings.actuator, self.model, settings.period)
        if self._friction is not None and not self.model.has_equations:
            raise BadInput(
                "a black box has friction of its own; give 0.0",
                key="actuator.viscous_friction, actuator.coulomb_friction",
            )
        self.last_tick = round(settings.duration / settings.period) if settings.duration else None
        require_allowed(settings.schedule, settings.allow_faults)
        self._names = names_of(self.model, self.limit)
        self._known_faults = injections_of(settings.schedule, self._names, settings.period)
        self.events: deque[Event] = deque()
        self.epoch, self.tick = -1, 0
        self.reset()
        self._warm()

    def _brake_damping(self, lowest_frequency: float) -> Vector:
        """Return the damping of the drive's brake, shape (joints,) [N m s/rad or N s/m]."""
        if isinstance(self._testbed, BlackBox):
            return np.array(self._testbed.brake_damping or np.zeros(self.limit.size))
        inertia = self.model.inertias(self._start)
        moved = np.where(np.isinf(inertia), 0.0, inertia)  # what moves no joint brakes nothing
        return self.settings.brake_damping_ratio * lowest_frequency * moved

    @property
    def own_clock(self) -> bool:
        """Whether the plant paces the ticks by a clock of its own."""
        return has_own_clock(self._testbed)

    def stop_plant(self) -> None:
        """Stop the motion of a black box until the next reset; a fault if it does not stop."""
        if self._plant is None:
            return
        try:
            self._plant.stop()
        except PlantFault as error:
            if not self.failure:
                self._fail(PlantLost(self.tick, self.time, str(error)))
        self._note_facts(self._plant)

    def _brake_plant(self, plant: RunningPlant) -> None:
        """End the run of a plant with its own clock, whose brake acts in place of the drive's."""
        words = "its brake is on"
        try:
            plant.stop()
        except PlantFault as error:
            words = str(error)
        self._fail(PlantLost(self.tick, self.time, f"no controller is active; {words}"))

    def _note_facts(self, plant: RunningPlant) -> None:
        while plant.facts:
            self.tell(plant.facts.popleft())

    def close(self) -> None:
        """End the process of a black box, which a reset starts again; others need no end."""
        if self._plant is not None:
            self._plant.close()
            self._plant = None

    def reset(self) -> None:
        """Return to tick 0 in a new epoch.

        Raises:
            BadInput: a black box cannot begin its first epoch; of a later one the run ends.
        """
        self.stop_plant()
        fault = self._reset_plant()
        self.handover.reset(
            SwitchRequest(entry.switch, self._tick_of(entry.at))
            for entry in self.settings.schedule
            if entry.switch is not None
        )
        self._current_testbed = self._testbed  # including the turns that operators have requested
        self.model = self._testbed.model()
        self.epoch += 1
        self.tick = 0
        self.actuator.reset()
        self.saturated_ticks = 0
        self.failure = ""  # why the run cannot go on, one line
        seed, period = self.settings.seed, self.settings.period
        self._sensors = Sensors(self.settings.sensors, self.model, period, [seed, self.epoch])
        self._x: Vector = self._start
        self._no_effort: Vector = read_only(np.zeros(self.model.joints))
        self._applied: Vector = self._no_effort
        self._extra: Vector = self._applied  # disturbance during the last tick
        self._total: Vector = self._applied  # both
        if self._sensor_check is not None:
            self._sensor_check.reset()
        self._tip_warnings: set[int] = set()  # tip readings that have been beyond small deflections
        self._answer: Vector | None = None
        self._lost = False  # the answer of this tick was given, and did not arrive
        self._injections = Injections(
            self._names, period, seed, self.epoch, self._known_faults, self.tell
        )
        self._faults = self._injections.faults
        self._start_tick()
        if fault is not None:
            self._fail(fault)

    def _reset_plant(self) -> PlantLost | None:
        """Let a black box return to tick 0; return why it cannot, if it could before."""
        if not isinstance(self._testbed, BlackBox):
            return None
        try:
            if self._plant is None:
                self._plant = self._testbed.start(self.settings.period)
            self._start = read_only(self._plant.reset())
        except PlantFault as error:
            if self.epoch < 0:
                self.close()
                raise BadInput(str(error), key="testbed") from None
            return PlantLost(0, 0.0, str(error))
        return None

    def place(self, x: Vector, applied: Vector, motors: Vector) -> None:
        """Go on from another state of motion at this tick, as nothing physical does.

        Args:
            x: [q, v].
            applied: effort during the last tick, shape (joints,) [N m or N].
            motors: torques of motors with a lag at the end of it, shape (joints,) [N m or N].

        Raises:
            BadInput: a black box begins where it begins.
        """
        if not self.model.has_equations:
            raise BadInput("a black box cannot be placed in another state", key="testbed")
        self._x, self._applied = read_only(x), read_only(applied)
        self._extra, self._total = self._no_effort, self._applied
        self.actuator.place(motors)
        self._start_tick()

    def _warm(self) -> None:
        """Compile and load what a tick needs, so that none of them waits for it."""
        self.truth()
        if self.model.has_equations:  # a black box would move
            self._integrate(self._applied)
        if self.settings.allow_faults:  # an operator may inject any
            load_steps()

    @property
    def testbed(self) -> Testbed:
        """What stands here, with the turns of the schedule and those of operators."""
        return self._current_testbed

    @property
    def time(self) -> float:
        """Simulated time of the tick [s]."""
        return self.tick * self.settings.period

    @property
    def done(self) -> bool:
        """The duration is over, or the state was lost."""
        over = self.last_tick is not None and self.tick >= self.last_tick
        return over or bool(self.failure)

    @property
    def faulted(self) -> bool:
        """A controller had to be replaced, or the state was lost."""
        return self.handover.faulted or bool(self.failure)

    @property
    def switch_results(self) -> deque[SwitchResult]:
        """What became of switches, the oldest first; its reader empties it."""
        return self.handover.results

    @property
    def answered(self) -> bool:
        """Nothing is to be waited for: the answer is here or lost for good, or the brake is on."""
        return self._answer is not None or self._lost or not self.drive.active

    def truth(self) -> Truth:
        """Return the state at this tick."""
        q, v = self.model.split(self._x)
        return Truth(
            self.tick,
            self.time,
            self.epoch,
            q,
            v,
            self._applied,
            self._extra,
            read_only(self.model.deflections(self._x)[0]),
            self.model.energy(self._x, self.time),
        )

    def offer(self, command: EffortCommand) -> bool:
        """Return whether the command settles the tick; a second answer is not needed.

        An answer that a fault keeps from the drive settles it too: no better one will come.

        Raises:
            BadInput: its effort is neither an array nor a list of real numbers.
        """
        if getattr(command.effort, "dtype", None) is not _FLOAT:
            command = command._replace(effort=_numbers(command.effort))
        question = self.question
        other = command.tick != question.tick or command.controller != question.controller
        if other and self.drive.is_repeat(command):
            return False
        if self._is_rejected(command) or self._answer is not None or self._lost:
            return False
        faults = self._faults
        if faults.at_work and faults.command_status(command) is not CommandStatus.ON_TIME:
            self._lost = True
            return True
        if not self.handover.answered(command.effort, self._applied):
            self.question = self.question._replace(controller=self.drive.active)
            return False
        self._answer = read_only(command.effort.copy())  # a copy: the sender may change its array
        return True

    def reject_sender(self, command: EffortCommand) -> None:
        """Reject an answer that comes from another process with the same controller name."""
        words = f"another process called {command.controller} answered than the one that counts"
        self._reject(command, RejectionReason.SENDER, words)

    def advance(self) -> None:
        """Integrate [t_k, t_k+1) with the answer, or with the last one if there is none.

        A state that is lost on the way ends the run: see `failure`; the truth stays at t_k.
        """
        drive, faults = self.drive, self._faults
        for old in faults.late_commands(first=False) if faults.late else ():
            self._is_rejected(old)
        if self._answer is not None:
            drive.take(self._answer)
        elif drive.active:
            self.handover.count_missing_answer()
        if self._plant is not None and not drive.active and self._ends_under_brake:
            self._brake_plant(self._plant)
            return
        demand = drive.effort(self._velocity)
        if faults.at_work:
            applied = faults.effort(self.actuator.apply(faults.demand(demand)))
        else:
            applied = self.actuator.apply(demand)
        if self._wheel_limits is not None:
            applied = self._wheel_limits.apply(applied, self._x)
        applied = read_only(applied)
        extra, total = self._no_effort, applied
        if self._injections.disturbances:
            extra = self._injections.disturbance(self.tick)
            total = read_only(applied + extra)
        try:
            after = read_only(self._integrate(total))
        except PlantFault as error:
            self._fail(PlantLost(self.tick, self.time, str(error)))
            return
        if is_lost(after):
            self._fail(self._lost_state(after, extra))
            return
        self._x, self._applied, self._extra, self._total = after, applied, extra, total
        self.saturated_ticks += self.actuator.saturated
        self.tick += 1
        if self._plant is not None and self._plant.facts:
            self._note_facts(self._plant)
        if self.tick == 1 and self.fast_mode is not None:
            self.tell(self.fast_mode)
        self._watch_tips()
        if self.tick == self.last_tick:
            self.handover.drop_all(RUN_OVER)
        self._start_tick()

    def _watch_tips(self) -> None:
        """Report appendages that deflect too far for their equations, once an epoch."""
        small = self.appendages.small
        if small is None:
            return
        tips = self.model.deflections(self._x)[0]
        for k in np.flatnonzero(np.abs(tips) > small).tolist():
            if k not in self._tip_warnings:
                self._tip_warnings.add(k)
                name, most = self.appendages.names[k], float(small[k])
                self.tell(LargeDeflection(name, float(tips[k]), most))

    def _integrate(self, effort: Vector) -> Vector:
        """Return the state at the end of the tick under this held effort, and friction.

        What no effort gives, `Model.outside`, pushes by half before and by half after (Strang
        1968): of second order.
        """
        if self._plant is not None:
            return self._plant.advance(effort)
        model, period, now = self.model, self.settings.period, self.time
        x = model.apply_impulse(self._x, 0.5 * period, now)
        if self._friction is None:
            after = model.advance_checked(x, effort, period, self._steps, now)
        else:
            after = self._friction.advance(
                x,
                effort,
                model.mobility(x, effort, now),
                lambda total: model.advance_checked(x, total, period, self._steps, now),
            )
        return model.apply_impulse(after, -0.5 * period, now + period)

    def request_switch(self, request: SwitchRequest) -> Refusal | None:
        """Schedule a switch at a tick (0: the next); return why it is refused, or None."""
        if rejection := past(request.tick, self.tick, self.settings.period):
            return rejection
        if request.tick <= self.tick:
            request = request._replace(tick=self.tick + 1)
        return self.handover.request(request, self.tick, self.last_tick)

    def set_ready_status(self, controller: str, why: Refusal | None) -> None:
        """Take that a controller could not take charge, and why, or could again (None)."""
        self.handover.set_ready_status(controller, why)

    def brake(self, on: bool, who: str = "") -> Refusal | None:
        """Latch or release the drive's own brake from the next tick on; return why not, or None."""
        return self.handover.brake(on, self.tick + 1, who)

    def inject(
        self, text: str, tick: int = 0, who: str = "", controllers: Sequence[str] = ()
    ) -> Reply:
        """Return whether a fault or disturbance that an operator requests is accepted, or why not.

        Args:
            text: YAML, see schedule.requested_entry.
            tick: tick at which it begins; 0: the next.
            who: name of the operator.
            controllers: controllers that exist and that a fault may silence; empty: unknown.
        """
        start = max(tick, self.tick + 1)
        if rejection := past(tick, self.tick, self.settings.period):
            return Reply(tick=self.tick, refused=rejection)
        if not self.settings.allow_faults:
            words = "faults are off in this trial; set allow_faults: true"
            return Reply(tick=self.tick, refused=Refusal(words, cause=Cause.FAULTS_OFF))
        try:
            entry = requested_entry(text, start * self.settings.period, self._testbed)
            period = self.settings.period
            names = self._names._replace(controllers=tuple(controllers))
            injection = injection_of(entry, names, period, "fault")
        except BadInput as error:
            return Reply(tick=self.tick, refused=error.refusal)
        if late := too_late(start, self.last_tick):
            return Reply(tick=self.tick, refused=late)
        word, number = self._injections.add(injection)
        self.tell(InjectionRequested(text, start, number, who, word))
        at = start * self.settings.period
        words = f"{word} from {at:g} s on (tick {start}, no. {number})"
        return Reply(words, tick=start, number=number)

    def retarget(self, text: str, tick: int = 0, who: str = "") -> Reply:
        """Return whether an appendage gets a new target, or why not.

        Args:
            text: YAML, see retarget.retargeted.
            tick: tick at which it begins to turn; 0: the next.
            who: name of the operator.
        """
        start = max(tick, self.tick + 1)
        if rejection := past(tick, self.tick, self.settings.period):
            return Reply(tick=self.tick, refused=rejection)
        try:
            at = start * self.settings.period
            new_testbed = with_target(self._current_testbed, requested_target(text), at, "target")
        except BadInput as error:
            return Reply(tick=self.tick, refused=error.refusal)
        if late := too_late(start, self.last_tick):
            return Reply(tick=self.tick, refused=late)
        self._current_testbed, self.model = new_testbed, new_testbed.model()
        what = TargetRequested(text, start, who)
        self.tell(what)
        return Reply(message_of(what), tick=start)

    def end_fault(self, number: int, who: str = "") -> Reply:
        """Return whether a fault or disturbance ends with the next tick, or why not.

        Args:
            number: number of the fault or disturbance, see active_faults.
            who: name of the operator.
        """
        here = {fault.number for fault in self.active_faults()}
        if number not in here:
            known = ", ".join(map(str, sorted(here))) or "none"
            words = f"no fault or disturbance {number}; active or due: {known}"
            return Reply(tick=self.tick, refused=Refusal(words, cause=Cause.UNKNOWN))
        end = self.tick + 1
        self._injections.end(number, end)
        what = FaultEndRequested(number, end, who)
        self.tell(what)
        return Reply(message_of(what), tick=end, number=number)

    def active_faults(self) -> list[ActiveFault]:
        """Return what disturbs or breaks now, or will."""
        return self._injections.active(self.tick)

    def over(self, tick: int) -> bool:
        """Return whether a requested tick is over; 0 stands for the next one."""
        return tick != 0 and tick < self.tick

    def _lost_state(self, after: Vector, disturbance: Vector) -> StateLost:
        """Return that the state a tick later is not finite."""
        where, cause = diagnosis(
            self.model,
            self._x,
            after,
            disturbance,
            self.limit,
            self.drive.active,
            self.settings.period / self._steps,
        )
        return StateLost(self.tick, self.time, where, cause)

    def _fail(self, what: StateLost | PlantLost) -> None:
        """End the run at this tick."""
        self.failure = message_of(what)
        self.tell(what)
        self.handover.drop_all(RUN_OVER)

    def _tick_of(self, time: float) -> int:
        return round(time / self.settings.period)

    def _start_tick(self) -> None:
        faults, time = self._faults, self.time
        if faults.waiting or faults.at_work or faults.late:
            self._injections.begin(self.tick, self.drive.demand, self._applied)
        self.handover.begin(self.tick)
        self._answer, self._lost = None, False
        exact = exact_readings(self.model, self._x, self._total, time)
        self._velocity = exact.joint_velocity
        readings = self._sensors.read(exact, self._x)
        if faults.at_work:
            readings = faults.read(readings)
        if self._sensor_check is not None:
            self._compare(self._sensor_check, readings)
        keep_all(readings)
        self.question = Measurement(
            self.tick,
            self.epoch,
            time,
            self.drive.active,
            *readings,
            self._applied,
        )
        for old in faults.late_commands(first=True) if faults.late else ():
            self._is_rejected(old)

    def _compare(self, sensor_check: Plausibility, readings: Readings) -> None:
        """Take the bench from the one in charge if the joint sensors contradict each other."""
        found = sensor_check.look(readings.joint_position, readings.joint_velocity)
        if found is None or not self.drive.active:
            return
        self.handover.reject_sensors(self._names.joints[found.joint], found.difference)

    def _is_rejected(self, command: EffortCommand) -> bool:
        """Return whether the drive rejects the command, and record the rejection."""
        found = self.drive.objection(self.question, command)
        if found is not None:
            self._reject(command, *found)
        return found is not None

    def _reject(self, command: EffortCommand, reason: RejectionReason, words: str) -> None:
        self.drive.rejected[reason] += 1
        count = self.drive.rejected[reason]
        if is_reported(count):
            self.tell(CommandRejected(reason, count, command.controller, words))

    def finish(self, wall_time: float) -> None:
        """Record the result of the run as an event.

        Args:
            wall_time: wall time during which ticks have passed [s].
        """
        self.stop_plant()
        saturated = self.saturated_ticks * self.settings.period
        rejected = {str(reason): count for reason, count in self.drive.rejected.items()}
        self.tell(RunFinished(wall_time, self.tick, self.drive.missed, saturated, rejected))

    def tell(self, what: Fact) -> None:
        """Note an event of the present tick."""
        self.events.append(event_of(what, self.tick, self.time, self.epoch, "plant"))
