"""A run of the bench against the wall clock: participants, pace and requests.

The session has no clock and no graph of its own: its caller passes in the time and what came,
calls `poll`, and sends the messages in `outbox`.
"""

from collections import deque
from collections.abc import Callable, Iterable
from typing import TypeAlias

from flexslew_plant.bench.bench import Bench, SwitchRequest, Truth
from flexslew_plant.bench.operation.backlog import Backlog
from flexslew_plant.bench.operation.pacing import Pacing
from flexslew_plant.bench.operation.presence import BEAT_EVERY, Presence
from flexslew_plant.bench.operation.run_state import PAUSED, WAITING, Reply, RunState
from flexslew_plant.events import (
    UNNAMED,
    Event,
    Fact,
    FellBehind,
    Interrupted,
    Noted,
    Paused,
    RateChanged,
    RecorderBack,
    RecorderLost,
    Resumed,
    Started,
    Stepped,
    WasReset,
    message_of,
    too_long,
)
from flexslew_plant.measurement import EffortCommand, Measurement
from flexslew_plant.refusal import Cause, Refusal

Outgoing: TypeAlias = Measurement | Truth | Event

_SILENT = Refusal("its heartbeat is lost", cause=Cause.NO_HEARTBEAT)
_ABSENT = Refusal("it is not on the graph", cause=Cause.ABSENT)
_JUST_COME = Refusal("it has just come", cause=Cause.NOT_READY)
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
        arrived: returns the commands that came and were not yet delivered by `take`.
    """

    def __init__(
        self,
        bench: Bench,
        controllers: tuple[str, ...],
        rate_factor: float,
        answer_timeout: float,
        autostart: bool,
        missing: Callable[[], list[str]],
        arrived: Callable[[], Iterable[EffortCommand]],
    ) -> None:
        self.bench = bench
        self.run = RunState(autostart)
        self.pacing = Pacing(bench.settings.period, rate_factor, answer_timeout)
        self.backlog = Backlog(patience=answer_timeout, paced=self.pacing.paced)
        self.presence = Presence()
        self.reasons: dict[str, Refusal | None] = {}  # why not ready, from their statuses
        self._said_by = dict[str, int]()  # the instance of each status; 0: not given
        self._answers = dict[str, int]()  # the accepted instance of each, until _look_around
        self.waiting_for: list[str] = []
        self.outbox: deque[Outgoing] = deque()
        self.watched: Callable[[], bool] = lambda: True  # whether this tick's truth is of use
        self._requested = controllers
        scheduled = (entry.switch for entry in bench.settings.schedule if entry.switch)
        self._named = {*bench.settings.fallback, *scheduled}  # may have to take over
        self._who = ""  # name of the operator that requested the start under way
        self._missing, self._arrived = missing, arrived
        self._shown = (0, -1)  # epoch and tick of the newest truth that went out
        self._late = (0, 0.0)  # how often behind the schedule, and by how much in all [wall s]
        self._next_look = 0.0
        self._held_since: float | None = None  # for the next controller [wall s]
        self._gone: set[str] = set()  # recorders that fell silent

    def poll(self, now: float) -> float:
        """Do what is due at this wall time [s]; return after how many seconds to be called."""
        if self.run.state == WAITING:
            self._try_begin(now)
        if not self.run.running:
            self._look_around(now)
            self._flush()
            return _POLL_PERIOD if self.run.state == WAITING else BEAT_EVERY
        held_up = self.pacing.look(now)
        self.presence.excuse(held_up)
        bench = self.bench
        if not bench.answered:  # what has come is taken before anybody is judged
            question = bench.question
            for command in self._arrived():
                if self._counts(command, now):
                    bench.offer(command)
            if bench.question is not question:  # a refused switch: ask the previous controller
                self.outbox.append(bench.question)
        self._look_around(now)
        drive = bench.drive
        alive = bool(drive.active) and not self.reason(drive.active, now)
        last_chance = alive and drive.one_miss_left
        if self.pacing.tick_over(now, bench.answered, drive.missed_in_a_row, last_chance):
            if self._held_back(now):
                return 0.005
            self._advance(now)
        elif not bench.answered and self.pacing.repeat_due(now):
            self.outbox.append(bench.question)
        self._flush()
        if bench.answered and not self.pacing.paced:
            return 0.0
        return self.pacing.wait(now)

    def take(self, command: EffortCommand, now: float) -> bool:
        """Take an answer; return whether `poll` is due at once."""
        if not self.run.running:
            self._take_at_rest(command, now)
            return False
        bench = self.bench
        question = bench.question
        if not self._counts(command, now):
            return False
        if bench.offer(command) and not self.pacing.paced:
            if self._held_back(now):
                return True
            self._advance(now)
        elif bench.question is not question:  # a refused switch: ask the previous controller
            self.outbox.append(bench.question)
        self._flush()
        return bool(bench.handover.results) or bench.answered

    def _take_at_rest(self, command: EffortCommand, now: float) -> None:
        """Keep an answer to the question that was out when the bench came to rest.

        Else its question would be repeated, and another process of that name might answer.
        """
        asked = self.bench.question
        about = command.tick, command.epoch, command.controller
        if about == (asked.tick, asked.epoch, asked.controller) and self._counts(command, now):
            self.bench.offer(command)
            self._flush()

    def _counts(self, command: EffortCommand, now: float) -> bool:
        """Return whether an answer comes from the node that counts for its name; else reject it."""
        name, instance = command.controller, command.instance
        if not instance or self._answers.get(name) == instance:
            return True
        if counts := self.presence.counts(name, instance, now):
            self._answers[name] = instance
        else:
            self.bench.turn_away(command)
        return counts

    def hear(self, controller: str, ready: bool, reason: str, instance: int = 0) -> None:
        """Take the status of a controller: whether it could take charge, and why not.

        Args:
            controller: name of the controller.
            ready: whether it could take charge.
            reason: why not.
            instance: instance that sent the status; 0: not given.
        """
        self._said_by[controller] = instance
        self.reasons[controller] = None if ready else Refusal(reason, cause=Cause.NOT_READY)

    def reason(self, controller: str, now: float) -> Refusal | None:
        """Return why a controller could not take charge now; None if it could."""
        if controller not in self.reasons:
            return _ABSENT
        if self.presence.silent(controller, now):
            return _SILENT
        if not self.presence.counts(controller, self._said_by.get(controller, 0), now):
            return _JUST_COME  # its predecessor was ready, not it
        bench = self.bench
        resting = not self.run.running
        behind = self.backlog.reason(controller, bench.tick, bench.epoch, resting)
        return self.reasons[controller] or behind

    def start(self, who: str = "") -> Reply:
        """Start or resume as soon as all are there."""
        reply = self.run.start()
        if not reply.ok:
            return reply
        self._who = who
        return Reply(f"starting at tick {self.bench.tick}")

    def pause(self, now: float, who: str = "") -> Reply:
        """Rest between two ticks."""
        reply = self.run.pause(now)
        return self._note_request(reply, Paused(self.bench.tick, who or UNNAMED))

    def step(self, ticks: int, who: str = "") -> Reply:
        """Fly some ticks of a paused bench."""
        reply = self.run.step(ticks)
        self._who = who
        return self._note_request(reply, Stepped(self.bench.tick, max(1, ticks), who or UNNAMED))

    def reset(self, who: str = "") -> Reply:
        """Return to tick 0 in a new epoch and rest there."""
        tick = self.bench.tick
        self.bench.reset()
        self.run.reset()
        return self._note_request(Reply(), WasReset(tick, self.bench.epoch, who or UNNAMED))

    def brake(self, on: bool, who: str = "") -> Reply:
        """Latch or release the drive's own brake from the next tick on."""
        refused = self.bench.brake(on, who)
        self._flush()
        words = f"{'brake latched' if on else 'brake released'} from tick {self.bench.tick + 1} on"
        return Reply(words, refused)

    def set_rate(self, rate_factor: float, now: float, who: str = "") -> Reply:
        """Go on at another rate from the next tick on; nothing of the trajectory changes."""
        if not 0.0 <= rate_factor < float("inf"):
            return Reply(refused=Refusal("0 (fast) or more", "rate_factor", rate_factor))
        self.pacing.set_rate(rate_factor, now)
        self.backlog.paced = self.pacing.paced
        return self._note_request(Reply(), RateChanged(rate_factor, who or UNNAMED))

    def note(self, text: str, who: str = "") -> Reply:
        """Keep an operator's remark in the log."""
        if not text.strip():
            return Reply(refused=Refusal("is empty; write something", "text"))
        if words := too_long(text):
            return Reply(refused=Refusal(words, "text"))
        self._note_request(Reply(), Noted(text.strip(), who or UNNAMED))
        return Reply(f"noted at tick {self.bench.tick}")

    def switch(self, request: SwitchRequest, now: float) -> Refusal | None:
        """Queue a switch; return why it is refused, or None. See Bench.request_switch.

        Not paced, a controller that has just fallen silent may be starved of processor time: the
        bench waits for it when the switch is due, see _held_back.
        """
        if request.controller not in self.reasons:
            known = ", ".join(sorted(self.reasons)) or "none"
            words = f"unknown controller {request.controller}; on the graph: {known}"
            return Refusal(words, cause=Cause.UNKNOWN)
        name = request.controller
        reason = self.reason(name, now)
        starved = not self.pacing.paced and not self.presence.lost(
            [name], self.backlog.patience, now
        )
        if reason is _SILENT and starved:
            reason = self.reasons[name]
        if reason is not None:
            return Refusal(f"{name} is not ready: {reason}", cause=reason.cause)
        refused = self.bench.request_switch(request)
        self._flush()
        return refused

    def interrupted(self) -> None:
        """Record that the run ends before its time, if it does."""
        if self.run.state in ("running", PAUSED) and self.bench.tick:
            self.bench.tell(Interrupted(self.bench.tick))
        self._flush()

    def _try_begin(self, now: float) -> None:
        """Begin as soon as all required nodes are present."""
        bench = self.bench
        reasons = {name: self.reason(name, now) for name in self.needed(now)}
        unready = {f"{name} ({why})" for name, why in reasons.items() if why}
        self.waiting_for = sorted({*self._missing(), *unready})
        if self.waiting_for:
            return
        self.run.begin(now)
        self.pacing.start(now)
        bench.tell((Started if bench.tick == 0 else Resumed)(bench.tick, self._who or UNNAMED))
        self._look_around(now)
        self._tell_tick()

    def needed(self, now: float) -> set[str]:
        """Return which controllers the bench waits for before a tick passes.

        At the first start all controllers of the trial; later only the active one is needed, and
        after a reset those that are still alive. The active one is not needed if it cannot go on
        and an operator has requested the brake or another controller from the next tick on.
        """
        bench, active = self.bench, self.bench.drive.active
        first, others = not (bench.tick or bench.epoch), set[str]()
        if bench.tick == 0:
            others = {n for n in self._requested if first or not self.presence.silent(n, now)}
        if not first and bench.handover.relieves(bench.tick + 1) and self._is_lost(active, now):
            active = ""
        return {*others, active} - {""}

    def _is_lost(self, controller: str, now: float) -> bool:
        """Return whether a controller seems gone for good, or has reported that it is not ready."""
        gone = bool(self.presence.lost([controller], self.backlog.patience, now))
        return gone or self.reasons.get(controller) is not None

    def _advance(self, now: float) -> None:
        self.bench.advance()
        if self.bench.done:
            self._finish(now)
            return
        behind = self.pacing.fall_behind(now)
        self.pacing.asked(now)
        if behind:
            self._tell_late(behind)
        self._tell_tick()
        self.run.ticked(now)

    def _tell_tick(self) -> None:
        """Send the question first: the answer is under way while the rest goes out.

        Where the bench rested with an answer, the question is not repeated: a controller that has
        come since starts with the next question, as the answer to this one is not its own.
        """
        if not (self.bench.drive.active and self.bench.answered):  # under the brake: to all
            self.outbox.append(self.bench.question)
        self._tell_truth()
        self._flush()

    def _tell_truth(self) -> None:
        tick = self.bench.epoch, self.bench.tick
        if tick != self._shown and self.watched():  # resumed: only the question is repeated
            self._shown = tick
            self.outbox.append(self.bench.truth())

    def _tell_late(self, behind: float) -> None:
        count, total = self._late[0] + 1, self._late[1] + behind
        self._late = count, total
        if count & (count - 1) == 0:  # the 1st, 2nd, 4th, 8th, ...: a slow machine stays readable
            self.bench.tell(FellBehind(behind, total, count))

    def _finish(self, now: float) -> None:
        self.run.finish(now)
        self._tell_truth()
        self.bench.finish(self.run.wall_time(now))
        self._flush()

    def _held_back(self, now: float) -> bool:
        """Return whether the next question must wait for a node that is behind or held up.

        The bench waits for a recorder, with or without a heartbeat: one starved of processor time
        sends none either, and what it has not received is lost if it dies. Paced, the bench waits
        for no other node. Not paced, a busy machine must not decide which controller takes over:
        the bench waits for one without a heartbeat that is next by a switch, or as a fallback after
        a miss now.
        """
        tick, epoch = self.bench.tick + 1, self.bench.epoch
        slow = self.backlog.slow(tick, epoch, now)
        if slow:
            recorders = self.presence.of_role("recorder")
            if any(name in recorders or not self.presence.silent(name, now) for name in slow):
                return True
        bench = self.bench
        if bench.answered and not bench.handover.waiting:  # the usual tick: no takeover
            self._held_since = None
            return False
        due = [*bench.handover.due(tick), *self._heirs(now)]
        if self.pacing.paced or not any(self.presence.silent(name, now) for name in due):
            self._held_since = None
            self._refresh(due, now)  # what was noted at the last look around may be over
            return False
        self._held_since = now if self._held_since is None else self._held_since
        return now - self._held_since <= self.backlog.patience

    def _heirs(self, now: float) -> list[str]:
        """Return the next controllers if this tick passes now, without those silent long before."""
        drive = self.bench.drive
        if self.bench.answered or not drive.active or not drive.one_miss_left:
            return []
        since = min(now, self.presence.last_heard(drive.active))
        heirs = self.bench.handover.heirs()
        return sorted({*heirs} - self.presence.lost(heirs, self.backlog.patience, since))

    def _refresh(self, controllers: Iterable[str], now: float) -> None:
        """Note which of these controllers can take charge at this moment."""
        for name in controllers:
            self.bench.handover.note_readiness(name, self.reason(name, now))

    def _look_around(self, now: float) -> None:
        """Note which nodes fell silent and which controllers can take charge."""
        if now < self._next_look and self.run.running:
            return
        self._next_look = now + BEAT_EVERY / 2
        self._answers.clear()
        if self.run.running:
            self._refresh(sorted({*self.reasons, *self._named}), now)
        for name in self.presence.of_role("recorder"):
            silent = self.presence.silent(name, now)
            if not silent:
                self.backlog.expect_recorder(name, self.bench.tick, self.bench.epoch)
            if silent and name not in self._gone:
                self._gone.add(name)
                self.bench.tell(RecorderLost(name))
            elif not silent and name in self._gone:
                self._gone.discard(name)
                self.bench.tell(RecorderBack(name))

    def _note_request(self, reply: Reply, what: Fact) -> Reply:
        """Note a request that was granted as an event; return the reply in its words."""
        if reply.ok:
            self.bench.tell(what)
        self._flush()
        return reply._replace(done=message_of(what))

    def _flush(self) -> None:
        """Hand out the events of the bench."""
        while self.bench.events:
            self.outbox.append(self.bench.events.popleft())
