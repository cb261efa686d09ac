"""A run of the bench against the wall clock: participants, pace and requests.

The session has no clock and no graph of its own: its caller passes in the time and what came,
calls `poll`, and sends the messages in `outbox`.
"""

from collections import deque
from collections.abc import Callable, Iterable
from math import inf
from typing import TypeAlias

from flexslew_plant.bench.bench import Bench, SwitchRequest, Truth
from flexslew_plant.bench.due_ticks import requested_tick
from flexslew_plant.bench.operation.backlog import NodeProgress
from flexslew_plant.bench.operation.pacing import TickTimer
from flexslew_plant.bench.operation.presence import HEARTBEAT_PERIOD, Heartbeats
from flexslew_plant.bench.operation.run_state import PAUSED, WAITING, RunState
from flexslew_plant.events import (
    NO_NAME,
    Event,
    Fact,
    OperatorNote,
    Paused,
    RateChanged,
    RecorderActive,
    RecorderLost,
    Resumed,
    RunStopped,
    ScheduleShifted,
    Started,
    StepsRequested,
    WasReset,
    message_of,
    too_long,
)
from flexslew_plant.measurement import EffortCommand, Measurement
from flexslew_plant.refusal import Cause, Refusal, Reply

Outgoing: TypeAlias = Measurement | Truth | Event

_HEARTBEAT_LOST = Refusal("its heartbeat is lost", cause=Cause.NO_HEARTBEAT)
_NOT_PRESENT = Refusal("it is not on the graph", cause=Cause.ABSENT)
_OWN_CLOCK = Refusal(
    "the plant has a clock of its own, which neither rests nor changes; brake or reset instead",
    cause=Cause.NOT_NOW,
)
_NEW_INSTANCE = Refusal("it has just come", cause=Cause.NOT_READY)
_POLL_PERIOD = 0.02  # between two checks for missing nodes [wall s]


class Session:
    """The state machine behind the plant node.

    Args:
        bench: the bench to run.
        controllers: controllers that must be ready before tick 0, in addition to the active one.
        rate_factor: simulated seconds per wall second; 0: as fast as possible.
        answer_timeout: silence that counts as missed ticks when not paced [wall s].
        autostart: start as soon as all are there.
        missing: returns the missing nodes without which no tick can pass, except unready ones.
        new_commands: returns the commands that came and were not yet delivered by `take`.
    """

    def __init__(
        self,
        bench: Bench,
        controllers: tuple[str, ...],
        rate_factor: float,
        answer_timeout: float,
        autostart: bool,
        missing: Callable[[], list[str]],
        new_commands: Callable[[], Iterable[EffortCommand]],
    ) -> None:
        self.bench = bench
        self.run = RunState(autostart)
        self.tick_timer = TickTimer(bench.settings.period, rate_factor, answer_timeout)
        if bench.own_clock:
            self.tick_timer.follow_plant()
        self.node_progress = NodeProgress(patience=answer_timeout, paced=self.tick_timer.real_time)
        self.heartbeats = Heartbeats()
        self.reasons: dict[str, Refusal | None] = {}  # why not ready, from their statuses
        self._status_instance = dict[str, int]()  # the instance of each status; 0: not given
        self._accepted_instance = dict[
            str, int
        ]()  # the accepted instance of each, until _update_nodes
        self.waiting_for: list[str] = []
        self.outgoing: deque[Outgoing] = deque()
        self.monitored: Callable[[], bool] = lambda: True  # whether this tick's truth is of use
        self._requested = controllers
        switch_targets = (entry.switch for entry in bench.settings.schedule if entry.switch)
        self._named = {*bench.settings.fallback, *switch_targets}  # may have to take over
        self._who = ""  # name of the operator that requested the start under way
        self._missing, self._new_commands = missing, new_commands
        self._last_truth = (0, -1)  # epoch and tick of the newest truth that went out
        self._late = (0, 0.0)  # how often behind the schedule, and by how much in all [wall s]
        self._next_check = 0.0
        self._wait_start: float | None = None  # for the next controller [wall s]
        self._lost_recorders: set[str] = set()  # recorders that fell silent

    def poll(self, now: float) -> float:
        """Do what is due at this wall time [s]; return after how many seconds to be called."""
        if self.run.state == WAITING:
            self._try_begin(now)
        if not self.run.running:
            self._update_nodes(now)
            self._flush()
            return _POLL_PERIOD if self.run.state == WAITING else HEARTBEAT_PERIOD
        delay = self.tick_timer.look(now)
        self.heartbeats.extend_timeouts(delay)
        bench = self.bench
        if not bench.answered:  # what has come is taken before anybody is judged
            question = bench.question
            for command in self._new_commands():
                if self._counts(command, now):
                    bench.offer(command)
            if bench.question is not question:  # a refused switch: ask the previous controller
                self.outgoing.append(bench.question)
        self._update_nodes(now)
        drive = bench.drive
        alive = bool(drive.active) and not self.reason(drive.active, now)
        is_final = alive and drive.one_miss_left
        if self.tick_timer.tick_over(now, bench.answered, drive.missing_ticks, is_final):
            if self._needs_wait(now):
                return 0.005
            self._advance(now)
        elif not bench.answered and self.tick_timer.check_repeat(now):
            self.outgoing.append(bench.question)
        self._flush()
        if bench.answered and not self.tick_timer.paced:
            return 0.0
        return self.tick_timer.wait(now, bench.answered)

    def take(self, command: EffortCommand, now: float) -> bool:
        """Take an answer; return whether `poll` is due at once."""
        if not self.run.running:
            self._take_at_rest(command, now)
            return False
        bench = self.bench
        question = bench.question
        if not self._counts(command, now):
            return False
        if bench.offer(command) and not self.tick_timer.paced:
            if self._needs_wait(now):
                return True
            self._advance(now)
        elif bench.question is not question:  # a refused switch: ask the previous controller
            self.outgoing.append(bench.question)
        self._flush()
        return bool(bench.handover.results) or bench.answered

    def _take_at_rest(self, command: EffortCommand, now: float) -> None:
        """Keep an answer to the question that was out when the bench came to rest.

        Else its question would be repeated, and another process of that name might answer.
        """
        question = self.bench.question
        key = command.tick, command.epoch, command.controller
        if key == (question.tick, question.epoch, question.controller) and self._counts(
            command, now
        ):
            self.bench.offer(command)
            self._flush()

    def _counts(self, command: EffortCommand, now: float) -> bool:
        """Return whether an answer comes from the node that counts for its name; else reject it."""
        name, instance = command.controller, command.instance
        if not instance or self._accepted_instance.get(name) == instance:
            return True
        if counts := self.heartbeats.counts(name, instance, now):
            self._accepted_instance[name] = instance
        else:
            self.bench.reject_sender(command)
        return counts

    def receive(self, controller: str, ready: bool, reason: str, instance: int = 0) -> None:
        """Take the status of a controller: whether it could take charge, and why not.

        Args:
            controller: name of the controller.
            ready: whether it could take charge.
            reason: why not.
            instance: instance that sent the status; 0: not given.
        """
        self._status_instance[controller] = instance
        self.reasons[controller] = None if ready else Refusal(reason, cause=Cause.NOT_READY)

    def reason(self, controller: str, now: float) -> Refusal | None:
        """Return why a controller could not take charge now; None if it could."""
        if controller not in self.reasons:
            return _NOT_PRESENT
        if self.heartbeats.inactive(controller, now):
            return _HEARTBEAT_LOST
        if not self.heartbeats.counts(controller, self._status_instance.get(controller, 0), now):
            return _NEW_INSTANCE  # its predecessor was ready, not it
        bench = self.bench
        at_rest = not self.run.running
        delay = self.node_progress.reason(controller, bench.tick, bench.epoch, at_rest)
        return self.reasons[controller] or delay

    def start(self, who: str = "") -> Reply:
        """Start or resume as soon as all are there."""
        reply = self.run.start()
        if not reply.ok:
            return reply
        self._who = who
        return Reply(f"starting at tick {self.bench.tick}")

    def pause(self, now: float, who: str = "") -> Reply:
        """Rest between two ticks."""
        if self.bench.own_clock:
            return Reply(refused=_OWN_CLOCK)
        reply = self.run.pause(now)
        return self._note_request(reply, Paused(self.bench.tick, who or NO_NAME))

    def step(self, ticks: int, who: str = "") -> Reply:
        """Fly some ticks of a paused bench."""
        if self.bench.own_clock:
            return Reply(refused=_OWN_CLOCK)
        reply = self.run.step(ticks)
        self._who = who
        return self._note_request(
            reply, StepsRequested(self.bench.tick, max(1, ticks), who or NO_NAME)
        )

    def reset(self, who: str = "") -> Reply:
        """Return to tick 0 in a new epoch and rest there."""
        tick = self.bench.tick
        self.bench.reset()
        self.run.reset()
        return self._note_request(Reply(), WasReset(tick, self.bench.epoch, who or NO_NAME))

    def brake(self, on: bool, who: str = "") -> Reply:
        """Latch or release the drive's own brake from the next tick on."""
        refusal = self.bench.brake(on, who)
        self._flush()
        words = f"{'brake latched' if on else 'brake released'} from tick {self.bench.tick + 1} on"
        return Reply(words, refusal)

    def set_rate(self, rate_factor: float, now: float, who: str = "") -> Reply:
        """Go on at another rate from the next tick on; nothing of the trajectory changes."""
        if not 0.0 <= rate_factor < float("inf"):
            return Reply(refused=Refusal("0 (fast) or more", "rate_factor", rate_factor))
        if self.bench.own_clock:
            return Reply(refused=_OWN_CLOCK)
        self.tick_timer.set_rate(rate_factor, now)
        self.node_progress.paced = self.tick_timer.paced
        return self._note_request(Reply(), RateChanged(rate_factor, who or NO_NAME))

    def note(self, text: str, who: str = "") -> Reply:
        """Keep an operator's remark in the log."""
        if not text.strip():
            return Reply(refused=Refusal("is empty; write something", "text"))
        if words := too_long(text):
            return Reply(refused=Refusal(words, "text"))
        self._note_request(Reply(), OperatorNote(text.strip(), who or NO_NAME))
        return Reply(f"noted at tick {self.bench.tick}")

    def requested_switch(
        self, controller: str, at: float, strict: bool, max_effort_step: float, who: str, now: float
    ) -> tuple[SwitchRequest, Refusal | None]:
        """Queue a switch as an operator requests it; return it, and why it is refused, or None.

        Args:
            controller: name of the controller that takes over.
            at: simulated time [s]; zero stands for the next tick.
            strict: whether a larger step of the effort than `max_effort_step` refuses the switch.
            max_effort_step: [N m or N].
            who: name of the operator.
            now: wall clock [s].
        """
        bench, limit = self.bench, max_effort_step if strict else inf
        tick = requested_tick(at, bench.settings.period, bench.tick)
        tick = tick if bench.over(tick) else max(tick, bench.tick + 1)
        request = SwitchRequest(controller, tick, strict, limit, who)
        if limit < 0.0:
            return request, Refusal("0 or more", "max_effort_step", limit)
        return request, self.switch(request, now)

    def switch(self, request: SwitchRequest, now: float) -> Refusal | None:
        """Queue a switch; return why it is refused, or None. See Bench.request_switch.

        Not paced, a controller that has just fallen silent may be starved of processor time: the
        bench waits for it when the switch is due, see _needs_wait.
        """
        if request.controller not in self.reasons:
            known = ", ".join(sorted(self.reasons)) or "none"
            words = f"unknown controller {request.controller}; on the graph: {known}"
            return Refusal(words, cause=Cause.UNKNOWN)
        name = request.controller
        reason = self.reason(name, now)
        is_busy = not self.tick_timer.real_time and not self.heartbeats.lost(
            [name], self.node_progress.patience, now
        )
        if reason is _HEARTBEAT_LOST and is_busy:
            reason = self.reasons[name]
        if reason is not None:
            return Refusal(f"{name} is not ready: {reason}", cause=reason.cause)
        refusal = self.bench.request_switch(request)
        self._flush()
        return refusal

    def interrupted(self) -> None:
        """Stop the plant, and record that the run ends before its time, if it does."""
        self.bench.stop_plant()
        if self.run.state in ("running", PAUSED) and self.bench.tick:
            self.bench.tell(RunStopped(self.bench.tick))
        self._flush()

    def _try_begin(self, now: float) -> None:
        """Begin as soon as all required nodes are present."""
        bench = self.bench
        reasons = {name: self.reason(name, now) for name in self.needed(now)}
        not_ready = {f"{name} ({why})" for name, why in reasons.items() if why}
        self.waiting_for = sorted({*self._missing(), *not_ready})
        if self.waiting_for:
            return
        self.run.begin(now)
        self.tick_timer.start(now)
        bench.tell((Started if bench.tick == 0 else Resumed)(bench.tick, self._who or NO_NAME))
        self._update_nodes(now)
        self._publish_tick()

    def needed(self, now: float) -> set[str]:
        """Return which controllers the bench waits for before a tick passes.

        At the first start all controllers of the trial; later only the active one is needed, and
        after a reset those that are still alive. The active one is not needed if it cannot go on
        and an operator has requested the brake or another controller from the next tick on.
        """
        bench, active = self.bench, self.bench.drive.active
        first, others = not (bench.tick or bench.epoch), set[str]()
        if bench.tick == 0:
            others = {n for n in self._requested if first or not self.heartbeats.inactive(n, now)}
        if (
            not first
            and bench.handover.has_replacement(bench.tick + 1)
            and self._is_lost(active, now)
        ):
            active = ""
        return {*others, active} - {""}

    def _is_lost(self, controller: str, now: float) -> bool:
        """Return whether a controller seems gone for good, or has reported that it is not ready."""
        is_lost = bool(self.heartbeats.lost([controller], self.node_progress.patience, now))
        return is_lost or self.reasons.get(controller) is not None

    def _advance(self, now: float) -> None:
        self.bench.advance()
        if self.bench.done:
            self._finish(now)
            return
        delay = self.tick_timer.shift_schedule(now)
        self.tick_timer.request(now)
        if delay:
            self._report_delay(delay)
        self._publish_tick()
        self.run.count_tick(now)

    def _publish_tick(self) -> None:
        """Send the question first: the answer is under way while the rest goes out.

        Where the bench rested with an answer, the question is not repeated: a controller that has
        come since starts with the next question, as the answer to this one is not its own.
        """
        if not (self.bench.drive.active and self.bench.answered):  # under the brake: to all
            self.outgoing.append(self.bench.question)
        self._publish_truth()
        self._flush()

    def _publish_truth(self) -> None:
        tick = self.bench.epoch, self.bench.tick
        if tick != self._last_truth and self.monitored():  # resumed: only the question is repeated
            self._last_truth = tick
            self.outgoing.append(self.bench.truth())

    def _report_delay(self, delay: float) -> None:
        count, total = self._late[0] + 1, self._late[1] + delay
        self._late = count, total
        if count & (count - 1) == 0:  # the 1st, 2nd, 4th, 8th, ...: a slow machine stays readable
            self.bench.tell(ScheduleShifted(delay, total, count))

    def _finish(self, now: float) -> None:
        self.run.finish(now)
        self._publish_truth()
        self.bench.finish(self.run.wall_time(now))
        self._flush()

    def _needs_wait(self, now: float) -> bool:
        """Return whether the next question must wait for a node that is behind or held up.

        The bench waits for a recorder, with or without a heartbeat: one starved of processor time
        sends none either, and what it has not received is lost if it dies. Paced, the bench waits
        for no other node. Not paced, a busy machine must not decide which controller takes over:
        the bench waits for one without a heartbeat that is next by a switch, or as a fallback after
        a miss now.
        """
        tick, epoch = self.bench.tick + 1, self.bench.epoch
        slow = self.node_progress.slow(tick, epoch, now)
        if slow:
            recorders = self.heartbeats.of_role("recorder")
            if any(name in recorders or not self.heartbeats.inactive(name, now) for name in slow):
                return True
        bench = self.bench
        if bench.answered and not bench.handover.waiting:  # the usual tick: no takeover
            self._wait_start = None
            return False
        pending = [*bench.handover.due(tick), *self._next_controllers(now)]
        if self.tick_timer.real_time or not any(
            self.heartbeats.inactive(name, now) for name in pending
        ):
            self._wait_start = None
            self._refresh(pending, now)  # what was noted at the last look around may be over
            return False
        self._wait_start = now if self._wait_start is None else self._wait_start
        return now - self._wait_start <= self.node_progress.patience

    def _next_controllers(self, now: float) -> list[str]:
        """Return the next controllers if this tick passes now, without those silent long before."""
        drive = self.bench.drive
        if self.bench.answered or not drive.active or not drive.one_miss_left:
            return []
        since = min(now, self.heartbeats.last_heartbeat_time(drive.active))
        candidates = self.bench.handover.next_controllers()
        return sorted(
            {*candidates} - self.heartbeats.lost(candidates, self.node_progress.patience, since)
        )

    def _refresh(self, controllers: Iterable[str], now: float) -> None:
        """Note which of these controllers can take charge at this moment."""
        for name in controllers:
            self.bench.handover.set_ready_status(name, self.reason(name, now))

    def _update_nodes(self, now: float) -> None:
        """Note which nodes fell silent and which controllers can take charge."""
        if now < self._next_check and self.run.running:
            return
        self._next_check = now + HEARTBEAT_PERIOD / 2
        self._accepted_instance.clear()
        if self.run.running:
            self._refresh(sorted({*self.reasons, *self._named}), now)
        for name in self.heartbeats.of_role("recorder"):
            lost = self.heartbeats.inactive(name, now)
            if not lost:
                self.node_progress.expect_recorder(name, self.bench.tick, self.bench.epoch)
            if lost and name not in self._lost_recorders:
                self._lost_recorders.add(name)
                self.bench.tell(RecorderLost(name))
            elif not lost and name in self._lost_recorders:
                self._lost_recorders.discard(name)
                self.bench.tell(RecorderActive(name))

    def _note_request(self, reply: Reply, what: Fact) -> Reply:
        """Note a request that was granted as an event; return the reply in its words."""
        if reply.ok:
            self.bench.tell(what)
        self._flush()
        return reply._replace(done=message_of(what))

    def _flush(self) -> None:
        """Hand out the events of the bench."""
        while self.bench.events:
            self.outgoing.append(self.bench.events.popleft())
