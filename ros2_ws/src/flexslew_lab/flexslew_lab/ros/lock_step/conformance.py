"""Whether an external controller keeps the lock-step, under the questions of a bad day.

The rules are those of docs/any_language.md. The bench here sways a little for any command: the
examination covers the ticks and times of answers, not their quality.
"""

from contextlib import suppress
from time import monotonic, time_ns
from typing import NamedTuple

import numpy as np

from flexslew_lab.ros.lock_step.controller_connection import ControllerConnection, ControllerFault
from flexslew_lab.run.controller_process import ControllerProcess
from flexslew_plant.bench.bench import Bench
from flexslew_plant.bench.message_fields import testbed_fields
from flexslew_plant.bench.operation.presence import HEARTBEAT_TIMEOUT
from flexslew_plant.graph import topics
from flexslew_plant.measurement import EffortCommand, Measurement

_LOCK_STEP_TICKS = 200  # in lock-step
_BATCH = 5  # questions sent without waiting for answers
_FAR = 3000  # ticks by which a stray question is ahead
_QUIET = 0.3  # in which an answer that must not come would have come [wall s]
_AMPLITUDE = 1e-3  # of the joints, at 1 rad/s [rad or m]
_RESET_TICKS = 3  # ticks after a reset that are answered as at the start
_OTHER_CONTROLLER, _NO_CONTROLLER = "somebody_else", ""  # the drive brakes
_MAX_QUEUE = 900  # questions after which a bench would soon wait for a controller that reports none
_MIDDLE, _REPEATS = 50, 3  # questions to others before and after one to it, while it is stopped
_MAX_DELAY, _LATE = 60.0, 1.0  # by which `since` may be before the examination, and after now [s]
_DEPTH = (
    "an estimator takes every question, so measurement is subscribed with a depth of "
    f"{topics.LOOP_DEPTH}"
)


class RuleResult(NamedTuple):
    """What became of one rule."""

    rule: str
    wrong: str  # in words; empty: it is kept

    @property
    def ok(self) -> bool:
        """It is kept."""
        return not self.wrong


class InterfaceTest:
    """A plant that sends its questions to one controller.

    Args:
        bench: bench with the announced testbed.
        patience: for anything that must come [wall s].
        process: of the controller.
    """

    def __init__(self, bench: Bench, patience: float, process: ControllerProcess) -> None:
        self._bench, self._patience, self._process = bench, patience, process
        self._start_time = time_ns()
        fields = testbed_fields(bench, {"bench": bench.settings})
        self._link = ControllerConnection(fields, patience, process.exit_words)
        self.close = self._link.close
        self._before: list[np.ndarray] = []  # efforts of the first epoch in lock-step, by tick
        self._epoch, self._tick = 0, -1

    def check_rules(self) -> list[RuleResult]:
        """Return a finding for each rule, in the order of docs/any_language.md.

        A rule that cannot be examined, since no controller has become ready, is not in the list.
        """
        rules = (
            ("status: ready after /testbed", self._check_ready),
            ("heartbeat: on alive, as a controller", self._check_heartbeat),
            ("first tick: the question is answered", self._first),
            (f"lock-step: {_LOCK_STEP_TICKS} questions, one answer each", self._lock_step),
            ("repeat: at most the same answer again", self._repeat),
            ("swap: no answers while another controller is named, and again at once", self._swap),
            ("late: questions that the bench does not wait for", self._check_late_queries),
            ("stray: a question from elsewhere changes nothing", self._check_wrong_tick),
            ("pause: nothing is published but heartbeats", self._pause),
            ("reset: a new epoch begins at tick 0", self._reset),
            (
                f"backlog: {_LOCK_STEP_TICKS} questions at once, all of them taken",
                self._check_queue,
            ),
            ("start: another process is another one", self._check_new_process),
        )
        found = []
        for rule, check in rules:
            wrong = ""
            try:
                check()
            except ControllerFault as error:
                wrong = str(error)
            ended = self._process.exit_words()
            wrong = ended or wrong
            found.append(RuleResult(rule, wrong))
            if ended or (wrong and len(found) == 1):
                break
            if wrong:  # what still comes is not taken for an answer to the next rule
                with suppress(ControllerFault):
                    self._link.spin(_QUIET)
        return found

    def _check_ready(self) -> None:
        link = self._link
        link.wait_for_start()
        link.spin(_QUIET)
        early = link.ready
        link.announce()
        if early:
            raise ControllerFault(
                "it reports ready before a testbed is announced; reason must state why not"
            )
        if link.best_effort:
            raise ControllerFault(
                "it subscribes to measurement as best effort, so that questions get lost: reliable"
            )

    def _check_heartbeat(self) -> None:
        self._require_heartbeats(3.0 * HEARTBEAT_TIMEOUT)

    def _require_heartbeats(self, seconds: float) -> None:
        """Listen to its signs of life for so long [wall s]."""
        self._link.heartbeats.clear()
        start = monotonic()
        self._link.spin(seconds)
        heartbeats = self._link.heartbeats.get(self._link.name, [])
        if not heartbeats:
            others = ", ".join(self._link.heartbeats) or "nobody"
            raise ControllerFault(f"no heartbeat of {self._link.name} on alive; received: {others}")
        if roles := {heartbeat.role for heartbeat, _ in heartbeats} - {"controller"}:
            raise ControllerFault(f"its role on alive is {min(roles)!r}; it must be 'controller'")
        if len(instances := {heartbeat.instance for heartbeat, _ in heartbeats}) > 1:
            raise ControllerFault("its instance on alive changes; a process draws it once")
        if instances == {0}:
            raise ControllerFault(
                "its instance on alive is 0; a process draws it, or two count as one"
            )
        self._check_start_time([heartbeat.since for heartbeat, _ in heartbeats])
        if self._link.status is not None and self._link.status.instance not in instances:
            raise ControllerFault(
                f"its instance is {min(instances)} on alive, {self._link.status.instance} in its "
                "controller_status; it must be the same"
            )
        max_gap = float(np.diff([start, *(at for _, at in heartbeats), monotonic()]).max())
        if max_gap > HEARTBEAT_TIMEOUT:
            raise ControllerFault(
                f"silent for {max_gap:.2f} s; after {HEARTBEAT_TIMEOUT:g} s it counts as gone"
            )

    def _check_start_time(self, since: list[int]) -> None:
        """Refuse a date of the start that would make it older than every namesake."""
        if len({*since}) > 1:
            raise ControllerFault("its since on alive changes; it is when the process started")
        early, late = self._start_time - int(1e9 * _MAX_DELAY), time_ns() + int(1e9 * _LATE)
        if not early <= since[0] <= late:
            raise ControllerFault(
                f"its since on alive is {since[0]}, {(since[0] - time_ns()) * 1e-9:.3g} s from "
                "now; it is when the process started [ns of the wall clock], or it counts before "
                "others of its name"
            )

    def _first(self) -> None:
        self._before = [self._query(0).effort]

    def _lock_step(self) -> None:
        for tick in range(1, _LOCK_STEP_TICKS):
            self._before.append(self._query(tick).effort)
        self._require_no_command("after the last question")
        self._check_last_tick(1)

    def _repeat(self) -> None:
        first = self._query(self._tick + 1)
        self._send_query(self._tick)
        self._link.spin(_QUIET)
        for command, at in self._link.commands:
            self._link.check(command, at, self._question(self._tick))
            if not np.array_equal(command.effort, first.effort):
                raise ControllerFault(
                    f"tick {self._tick} repeated: another effort than the first time"
                )
        if len(self._link.commands) > 1:
            raise ControllerFault(f"tick {self._tick} repeated: {len(self._link.commands)} answers")

    def _swap(self) -> None:
        self._link.commands.clear()
        for who, words in (
            (_OTHER_CONTROLLER, "name another controller"),
            (_NO_CONTROLLER, "name no controller"),
        ):
            for _ in range(_BATCH):
                self._send_query(self._tick + 1, who)
            self._require_no_command(f"to questions that {words}")
            self._ready(f"to take over from questions that {words}")
        self._query(self._tick + 1)

    def _check_late_queries(self) -> None:
        self._link.commands.clear()
        begin = self._tick + 1
        for tick in range(begin, begin + _BATCH):
            self._send_query(tick)
        last = begin + _BATCH - 1
        self._link.until(
            lambda: any(c.tick == last for c, _ in self._link.commands),
            f"no answer to tick {last}, the last of {_BATCH} sent one after the other",
        )
        self._link.spin(_QUIET)
        ticks = [command.tick for command, _ in self._link.commands]
        for command, at in self._link.commands:
            self._link.check(command, at, self._question(command.tick))
        if ticks != sorted(set(ticks)) or not set(ticks) <= set(range(begin, last + 1)):
            raise ControllerFault(f"ticks {begin} to {last} were sent, {ticks} answered")

    def _check_wrong_tick(self) -> None:
        self._link.commands.clear()
        true_tick = self._tick
        self._send_query(true_tick + _FAR)
        self._link.spin(_QUIET)
        self._link.commands.clear()
        self._query(true_tick + 1)

    def _pause(self) -> None:
        self._link.commands.clear()
        self._link.publish_state("paused", self._tick, self._epoch)
        try:
            self._require_heartbeats(2.0 * HEARTBEAT_TIMEOUT)
        except ControllerFault as error:
            raise ControllerFault(f"while the bench is paused: {error}") from None
        if self._link.commands:
            raise ControllerFault(f"{len(self._link.commands)} answers without a question")
        self._ready("while the bench is paused")
        self._link.publish_state("running", self._tick, self._epoch)
        self._query(self._tick + 1)

    def _reset(self) -> None:
        self._begin_epoch()
        for tick in range(_RESET_TICKS):
            effort = self._query(tick).effort
            if tick < len(self._before) and not np.array_equal(effort, self._before[tick]):
                raise ControllerFault(
                    f"tick {tick} of the new epoch: another effort than at the start, where the "
                    "question was the same; a controller restarts"
                )
        self._check_last_tick(0)

    def _check_queue(self) -> None:
        """Ask as in lock-step, but at once: what has memory answers the last one alike."""
        self._begin_epoch()
        self._query(0)
        self._link.commands.clear()
        last = _LOCK_STEP_TICKS - 1
        for tick in range(1, _LOCK_STEP_TICKS):
            self._send_query(tick)
        self._link.until(
            lambda: any(c.tick == last for c, _ in self._link.commands),
            f"no answer to tick {last}, the last of {_LOCK_STEP_TICKS} sent one after the other",
        )
        effort = next(c.effort for c, _ in self._link.commands if c.tick == last)
        if len(self._before) == _LOCK_STEP_TICKS and not np.array_equal(effort, self._before[last]):
            raise ControllerFault(
                f"tick {last} of questions that piled up: another effort than where each was "
                f"waited for; {_DEPTH}"
            )
        for _ in range(_REPEATS):
            self._check_stopped_process()

    def _check_stopped_process(self) -> None:
        """Send questions while its process is stopped: one to it between many to others."""
        requested = self._tick + _MIDDLE + 1
        self._link.commands.clear()
        self._process.stop(True)
        try:
            for _ in range(2 * _MIDDLE + 1):
                self._send_query(
                    self._tick + 1, None if self._tick + 1 == requested else _OTHER_CONTROLLER
                )
            self._link.spin(_QUIET)
        finally:
            self._process.stop(False)
        self._link.until(
            lambda: bool(self._link.commands),
            f"no answer to tick {requested}, one of {2 * _MIDDLE + 1} that came while it was "
            "stopped; "
            f"{_DEPTH}",
        )
        self._link.take_answer(self._question(requested))

    def _check_new_process(self) -> None:
        """Compare what two processes of the same command have drawn."""
        instances = self._link.instances
        if not instances:
            raise ControllerFault(f"no heartbeat of {self._link.name} on alive")
        ignored = self._process.restart()
        self._link.spin(_QUIET)  # the last ones of the process that has ended
        self._link.heartbeats.clear()
        self._link.until(
            lambda: bool(self._link.instances),
            f"no heartbeat of {self._link.name} after a start",
        )
        if repeated := instances & self._link.instances:
            raise ControllerFault(
                f"its instance on alive is {min(repeated)} after a new start, too; each process "
                "draws "
                "its own, or one that comes back counts as its predecessor"
            )
        if ignored:
            raise ControllerFault(ignored)

    def _begin_epoch(self) -> None:
        self._epoch += 1
        self._tick = -1
        self._link.publish_state("running", self._tick, self._epoch)

    def _check_last_tick(self, least: int) -> None:
        """Ask on until the status has a tick of this epoch, from `least` on."""

        def has_status() -> bool:
            status = self._link.status
            assert status is not None
            return bool(status.epoch == self._epoch and least <= status.last_tick <= self._tick)

        self._link.spin(_QUIET)
        while not has_status() and self._tick < _MAX_QUEUE:
            self._query(self._tick + 1)
        self._link.spin(_QUIET)
        if not has_status():
            status = self._link.status
            assert status is not None
            raise ControllerFault(
                f"after tick {self._tick} of epoch {self._epoch} its controller_status has tick "
                f"{status.last_tick} of epoch {status.epoch}; a bench waits for a "
                "controller that is 1,000 ticks behind"
            )

    def _query(self, tick: int) -> EffortCommand:
        """Ask, and return the one answer."""
        self._tick = tick
        return self._link.ask(self._question(tick))

    def _require_no_command(self, when: str) -> None:
        self._link.spin(_QUIET)
        if self._link.commands:
            raise ControllerFault(f"{len(self._link.commands)} answers {when}")

    def _ready(self, when: str) -> None:
        """Refuse a controller that could not take charge."""
        if self._link.status is not None and not self._link.status.ready:
            raise ControllerFault(f"not ready {when}: {self._link.status.reason}")

    def _send_query(self, tick: int, who: str | None = None) -> None:
        """Ask a question; None: the controller itself."""
        self._tick = tick
        self._link.send(self._question(tick, who))

    def _question(self, tick: int, who: str | None = None) -> Measurement:
        """Return the question of a tick; None: to the controller itself."""
        model, appendages = self._bench.model, len(self._bench.appendages.names)
        at, tips = tick * self._bench.settings.period, np.zeros(appendages)
        phase = at + np.arange(model.joints)
        return Measurement(
            tick,
            self._epoch,
            at,
            self._link.name if who is None else who,
            _AMPLITUDE * np.sin(phase),
            _AMPLITUDE * np.cos(phase),
            tips,
            tips,
            np.zeros(model.efforts),
        )
