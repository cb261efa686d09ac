"""Whether an external controller keeps the lock-step, under the questions of a bad day.

The rules are those of docs/any_language.md. The bench here sways a little for any command: the
examination covers the ticks and times of answers, not their quality.
"""

from collections.abc import Callable
from contextlib import suppress
from struct import Struct
from time import monotonic, time_ns
from typing import NamedTuple

import numpy as np
import rclpy
from flexslew_msgs import msg
from rclpy.experimental import EventsExecutor
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from flexslew_plant.bench.bench import Bench
from flexslew_plant.bench.message_fields import testbed_fields
from flexslew_plant.bench.operation.presence import SILENT_AFTER
from flexslew_plant.bench.wire import command_from, measurement_bytes
from flexslew_plant.graph import topics
from flexslew_plant.measurement import EffortCommand, Measurement
from flexslew_plant.network import demand_loopback
from flexslew_plant.processes.atomic import atomic
from flexslew_plant.ros.alive import Alive
from flexslew_plant.ros.messages import message_of, stamp
from flexslew_plant.ros.offers import publisher, subscription
from flexslew_plant.ros.start import start_ros

_QUESTIONS = 200  # in lock-step
_BURST = 5  # questions sent without waiting for answers
_FAR = 3000  # ticks by which a stray question is ahead
_QUIET = 0.3  # in which an answer that must not come would have come [wall s]
_SWAY = 1e-3  # of the joints, at 1 rad/s [rad or m]
_AFRESH = 3  # ticks after a reset that are answered as at the start
_SOMEBODY, _NOBODY = "somebody_else", ""  # the drive brakes
_BEHIND = 900  # questions after which a bench would soon wait for a controller that reports none
_STAMP, _HEAD = Struct("<iI"), 4  # of an answer, behind the encapsulation of CDR
_MIDDLE, _ROUNDS = 50, 3  # questions to others before and after one to it, while it is stopped
_EARLY, _LATE = 60.0, 1.0  # by which `since` may be before the examination, and after now [s]
_DEPTH = (
    "an estimator takes every question, so measurement is subscribed with a depth of "
    f"{topics.LOOP_DEPTH}"
)
_ENDED = "its process has ended"


class RuleFinding(NamedTuple):
    """What became of one rule."""

    rule: str
    wrong: str  # in words; empty: it is kept

    @property
    def ok(self) -> bool:
        """It is kept."""
        return not self.wrong


class Wrong(Exception):
    """A rule is broken, in words."""


class Examiner:
    """A plant that sends its questions to one controller.

    Args:
        bench: bench with the announced testbed.
        patience: for anything that must come [wall s].
        running: returns whether the controller's process still runs.
        start_again: ends the process and starts another one; returns what was wrong, or "".
        stop: stops the process (True), or lets it go on.
    """

    def __init__(
        self,
        bench: Bench,
        patience: float,
        running: Callable[[], bool],
        start_again: Callable[[], str],
        stop: Callable[[bool], None],
    ) -> None:
        self._bench, self._patience, self._running = bench, patience, running
        self._start_again, self._stop = start_again, stop
        self._began = time_ns()
        # the arguments of this process are those of the controller
        start_ros(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self._node = node = rclpy.create_node("plant")
        self._executor = EventsExecutor()
        self._executor.add_node(node)
        demand_loopback()
        self._alive = Alive(node, "plant")
        self._ask = publisher(node, topics.MEASUREMENT)
        self._state = publisher(node, topics.BENCH_STATE)
        self._answers: list[tuple[EffortCommand, float]] = []  # with the stamp [s]
        self._unreadable = ""  # what is wrong with the newest answer
        self._status: msg.ControllerStatus | None = None
        self._beats: dict[str, list[tuple[msg.Alive, float]]] = {}  # by node, with the wall time
        self._before: list[np.ndarray] = []  # efforts of the first epoch in lock-step, by tick
        self._answered_last = -1  # tick of this epoch
        subscription(node, topics.EFFORT_COMMAND, self._on_command, raw=True)
        subscription(node, topics.CONTROLLER_STATUS, self._on_status)
        subscription(node, topics.ALIVE, self._on_beat)
        self._testbed = publisher(node, topics.TESTBED)
        self._epoch, self._tick = 0, -1
        self._who = ""

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown()

    def examine(self) -> list[RuleFinding]:
        """Return a finding for each rule, in the order of docs/any_language.md.

        A rule that cannot be examined, since no controller has become ready, is not in the list.
        """
        rules = (
            ("status: ready after /testbed", self._becomes_ready),
            ("heartbeat: on alive, as a controller", self._beats_in_time),
            ("first tick: the question is answered", self._first),
            (f"lock-step: {_QUESTIONS} questions, one answer each", self._lock_step),
            ("repeat: at most the same answer again", self._repeat),
            ("swap: no answers while another controller is named, and again at once", self._swap),
            ("late: questions that the bench does not wait for", self._burst),
            ("stray: a question from elsewhere changes nothing", self._stray),
            ("pause: nothing is published but heartbeats", self._pause),
            ("reset: a new epoch begins at tick 0", self._reset),
            (f"backlog: {_QUESTIONS} questions at once, all of them taken", self._backlog),
            ("start: another process is another one", self._another),
        )
        found = []
        for rule, look in rules:
            wrong = ""
            try:
                look()
            except Wrong as error:
                wrong = str(error)
            if not self._running():
                wrong = _ENDED
            found.append(RuleFinding(rule, wrong))
            if wrong == _ENDED or (wrong and len(found) == 1):
                break
            if wrong:  # what still comes is not taken for an answer to the next rule
                with suppress(Wrong):
                    self._spin(_QUIET)
        return found

    def _becomes_ready(self) -> None:
        self._until(
            lambda: self._status is not None or self._testbed.get_subscription_count() > 0,
            "nothing was received on controller_status",
        )
        self._spin(_QUIET)
        early = self._status is not None and self._status.ready
        fields = {
            "stamp": stamp(0.0),
            **testbed_fields(self._bench, {"bench": self._bench.settings}),
        }
        self._testbed.publish(message_of(msg.Testbed, fields))
        self._until(lambda: self._status is not None, "nothing was received on controller_status")
        self._until(
            lambda: self._status is not None and self._status.ready,
            lambda: f"it is not ready: {self._status.reason if self._status else ''}",
        )
        assert self._status is not None
        self._who = self._status.controller
        if not self._who:
            raise Wrong("controller is empty in its controller_status; it must be its name")
        self._until(
            lambda: self._ask.get_subscription_count() > 0, "measurement has no subscription"
        )
        if early:
            raise Wrong("it reports ready before a testbed is announced; reason must state why not")
        asked = self._node.get_subscriptions_info_by_topic(self._ask.topic_name)
        if any(one.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT for one in asked):
            raise Wrong(
                "it subscribes to measurement as best effort, so that questions get lost: reliable"
            )

    def _beats_in_time(self) -> None:
        self._beats_for(3.0 * SILENT_AFTER)

    def _beats_for(self, seconds: float) -> None:
        """Listen to its signs of life for so long [wall s]."""
        self._beats.clear()
        began = monotonic()
        self._spin(seconds)
        beats = self._beats.get(self._who, [])
        if not beats:
            others = ", ".join(self._beats) or "nobody"
            raise Wrong(f"no heartbeat of {self._who} on alive; received: {others}")
        if roles := {beat.role for beat, _ in beats} - {"controller"}:
            raise Wrong(f"its role on alive is {min(roles)!r}; it must be 'controller'")
        if len(drawn := {beat.instance for beat, _ in beats}) > 1:
            raise Wrong("its instance on alive changes; a process draws it once")
        if drawn == {0}:
            raise Wrong("its instance on alive is 0; a process draws it, or two count as one")
        self._dated([beat.since for beat, _ in beats])
        if self._status is not None and self._status.instance not in drawn:
            raise Wrong(
                f"its instance is {min(drawn)} on alive, {self._status.instance} in its "
                "controller_status; it must be the same"
            )
        longest = float(np.diff([began, *(at for _, at in beats), monotonic()]).max())
        if longest > SILENT_AFTER:
            raise Wrong(f"silent for {longest:.2f} s; after {SILENT_AFTER:g} s it counts as gone")

    def _dated(self, since: list[int]) -> None:
        """Refuse a date of the start that would make it older than every namesake."""
        if len({*since}) > 1:
            raise Wrong("its since on alive changes; it is when the process started")
        early, late = self._began - int(1e9 * _EARLY), time_ns() + int(1e9 * _LATE)
        if not early <= since[0] <= late:
            raise Wrong(
                f"its since on alive is {since[0]}, {(since[0] - time_ns()) * 1e-9:.3g} s from "
                "now; it is when the process started [ns of the wall clock], or it counts before "
                "others of its name"
            )

    def _first(self) -> None:
        self._before = [self._answered(0).effort]

    def _lock_step(self) -> None:
        for tick in range(1, _QUESTIONS):
            self._before.append(self._answered(tick).effort)
        self._nothing_more("after the last question")
        self._tells_what_it_has_seen(1)

    def _repeat(self) -> None:
        first = self._answered(self._tick + 1)
        self._say(self._tick)
        self._spin(_QUIET)
        for command, at in self._answers:
            self._check(command, at, self._tick)
            if not np.array_equal(command.effort, first.effort):
                raise Wrong(f"tick {self._tick} repeated: another effort than the first time")
        if len(self._answers) > 1:
            raise Wrong(f"tick {self._tick} asked again: {len(self._answers)} answers")

    def _swap(self) -> None:
        self._answers.clear()
        for who, words in ((_SOMEBODY, "name another controller"), (_NOBODY, "name no controller")):
            for _ in range(_BURST):
                self._say(self._tick + 1, who)
            self._nothing_more(f"to questions that {words}")
            self._ready(f"to take over from questions that {words}")
        self._answered(self._tick + 1)

    def _burst(self) -> None:
        self._answers.clear()
        begin = self._tick + 1
        for tick in range(begin, begin + _BURST):
            self._say(tick)
        last = begin + _BURST - 1
        self._until(
            lambda: any(c.tick == last for c, _ in self._answers),
            f"no answer to tick {last}, the last of {_BURST} sent one after the other",
        )
        self._spin(_QUIET)
        ticks = [command.tick for command, _ in self._answers]
        for command, at in self._answers:
            self._check(command, at, command.tick)
        if ticks != sorted(set(ticks)) or not set(ticks) <= set(range(begin, last + 1)):
            raise Wrong(f"ticks {begin} to {last} were asked, {ticks} answered")

    def _stray(self) -> None:
        self._answers.clear()
        true_tick = self._tick
        self._say(true_tick + _FAR)
        self._spin(_QUIET)
        self._answers.clear()
        self._answered(true_tick + 1)

    def _pause(self) -> None:
        self._answers.clear()
        self._tell_state("paused")
        try:
            self._beats_for(2.0 * SILENT_AFTER)
        except Wrong as error:
            raise Wrong(f"while the bench is paused: {error}") from None
        if self._answers:
            raise Wrong(f"{len(self._answers)} answers without a question")
        self._ready("while the bench is paused")
        self._tell_state("running")
        self._answered(self._tick + 1)

    def _reset(self) -> None:
        self._begin_epoch()
        for tick in range(_AFRESH):
            effort = self._answered(tick).effort
            if tick < len(self._before) and not np.array_equal(effort, self._before[tick]):
                raise Wrong(
                    f"tick {tick} of the new epoch: another effort than at the start, where the "
                    "question was the same; a controller begins anew"
                )
        self._tells_what_it_has_seen(0)

    def _backlog(self) -> None:
        """Ask as in lock-step, but at once: what has memory answers the last one alike."""
        self._begin_epoch()
        self._answered(0)
        self._answers.clear()
        last = _QUESTIONS - 1
        for tick in range(1, _QUESTIONS):
            self._say(tick)
        self._until(
            lambda: any(c.tick == last for c, _ in self._answers),
            f"no answer to tick {last}, the last of {_QUESTIONS} sent one after the other",
        )
        effort = next(c.effort for c, _ in self._answers if c.tick == last)
        if len(self._before) == _QUESTIONS and not np.array_equal(effort, self._before[last]):
            raise Wrong(
                f"tick {last} of questions that piled up: another effort than where each was "
                f"waited for; {_DEPTH}"
            )
        for _ in range(_ROUNDS):
            self._answered_after_a_stop()

    def _answered_after_a_stop(self) -> None:
        """Send questions while its process is stopped: one to it between many to others."""
        asked = self._tick + _MIDDLE + 1
        self._answers.clear()
        self._stop(True)
        try:
            for _ in range(2 * _MIDDLE + 1):
                self._say(self._tick + 1, None if self._tick + 1 == asked else _SOMEBODY)
            self._spin(_QUIET)
        finally:
            self._stop(False)
        self._until(
            lambda: bool(self._answers),
            f"no answer to tick {asked}, one of {2 * _MIDDLE + 1} that came while it was stopped; "
            f"{_DEPTH}",
        )
        command, at = self._answers.pop(0)
        self._check(command, at, asked)

    def _another(self) -> None:
        """Compare what two processes of the same command have drawn."""
        drawn = {beat.instance for beat, _ in self._beats.get(self._who, [])}
        if not drawn:
            raise Wrong(f"no heartbeat of {self._who} on alive")
        ignored = self._start_again()
        self._spin(_QUIET)  # the last ones of the process that has ended
        self._beats.clear()
        self._until(lambda: self._who in self._beats, f"no heartbeat of {self._who} after a start")
        if again := drawn & {beat.instance for beat, _ in self._beats[self._who]}:
            raise Wrong(
                f"its instance on alive is {min(again)} after a new start, too; each process draws "
                "its own, or one that comes back counts as its predecessor"
            )
        if ignored:
            raise Wrong(ignored)

    def _begin_epoch(self) -> None:
        self._epoch += 1
        self._tick = self._answered_last = -1
        self._tell_state("running")

    def _tells_what_it_has_seen(self, least: int) -> None:
        """Ask on until the status has a tick of this epoch, from `least` on."""

        def told() -> bool:
            status = self._status
            assert status is not None
            return bool(status.epoch == self._epoch and least <= status.last_tick <= self._tick)

        self._spin(_QUIET)
        while not told() and self._tick < _BEHIND:
            self._answered(self._tick + 1)
        self._spin(_QUIET)
        if not told():
            assert self._status is not None
            raise Wrong(
                f"after tick {self._tick} of epoch {self._epoch} its controller_status has tick "
                f"{self._status.last_tick} of epoch {self._status.epoch}; a bench waits for a "
                "controller that is 1,000 ticks behind"
            )

    def _answered(self, tick: int) -> EffortCommand:
        """Ask, and return the one answer."""
        self._answers.clear()
        self._say(tick)
        self._until(lambda: bool(self._answers), f"no answer to tick {tick}")
        command, at = self._answers.pop(0)
        self._check(command, at, tick)
        self._answered_last = tick
        return command

    def _check(self, command: EffortCommand, at: float, tick: int) -> None:
        """Refuse an answer that a bench would reject."""
        where = f"answer to tick {tick} of epoch {self._epoch}"
        if (command.tick, command.epoch) != (tick, self._epoch):
            if command.epoch == self._epoch and command.tick == self._answered_last:
                raise Wrong(f"tick {command.tick} of epoch {command.epoch} is answered twice")
            raise Wrong(f"{where}: it has tick {command.tick} of epoch {command.epoch}")
        if command.controller != self._who:
            raise Wrong(f"{where}: controller is {command.controller!r}, not {self._who!r}")
        size = self._bench.model.efforts
        if command.effort.shape != (size,):
            raise Wrong(f"{where}: {command.effort.size} efforts; the bench has {size} actuators")
        if not np.isfinite(command.effort).all():
            raise Wrong(f"{where}: an effort is not finite")
        told = {beat.instance for beat, _ in self._beats.get(self._who, [])}
        if told and command.instance not in {0, *told}:
            raise Wrong(
                f"{where}: its instance is {command.instance}, on alive {min(told)}; a bench takes "
                "it for another process of that name"
            )
        expected = tick * self._bench.settings.period
        if abs(at - expected) > 1e-9:
            raise Wrong(f"{where}: its stamp is {at:.9g} s; that of the question is {expected:.9g}")

    def _nothing_more(self, when: str) -> None:
        self._spin(_QUIET)
        if self._answers:
            raise Wrong(f"{len(self._answers)} answers {when}")

    def _ready(self, when: str) -> None:
        """Refuse a controller that could not take charge."""
        if self._status is not None and not self._status.ready:
            raise Wrong(f"not ready {when}: {self._status.reason}")

    def _say(self, tick: int, who: str | None = None) -> None:
        """Ask a question; None: the controller itself."""
        model, appendages = self._bench.model, len(self._bench.appendages.names)
        at, tips = tick * self._bench.settings.period, np.zeros(appendages)
        phase = at + np.arange(model.joints)
        self._tick, held = tick, np.zeros(model.efforts)
        question = Measurement(
            tick,
            self._epoch,
            at,
            self._who if who is None else who,
            _SWAY * np.sin(phase),
            _SWAY * np.cos(phase),
            tips,
            tips,
            held,
        )
        self._ask.publish(measurement_bytes(question))

    def _tell_state(self, state: str) -> None:
        self._state.publish(
            msg.BenchState(
                state=state, tick=max(self._tick, 0), epoch=self._epoch, active=self._who
            )
        )

    def _until(self, done: Callable[[], bool], otherwise: str | Callable[[], str]) -> None:
        """Wait for something.

        Raises:
            Wrong: it has not come in time, or the controller's process has ended.
        """
        end = monotonic() + self._patience
        while not done():
            if not self._running():
                raise Wrong(_ENDED)
            if monotonic() > end:
                words = otherwise if isinstance(otherwise, str) else otherwise()
                raise Wrong(f"{words} within {self._patience:g} s{self._deaf()}")
            self._serve(0.05)

    def _spin(self, seconds: float) -> None:
        end = monotonic() + seconds
        while (left := end - monotonic()) > 0.0:
            self._serve(min(left, 0.05))

    def _serve(self, timeout: float) -> None:
        self._alive.poll(monotonic())
        with atomic:  # as a node's loop does
            self._executor.spin_once(timeout_sec=timeout)
        if self._unreadable:
            words, self._unreadable = self._unreadable, ""
            raise Wrong(f"a bench cannot read its answer: {words}")

    def _on_command(self, data: bytes) -> None:
        try:
            command = command_from(data)
        except ValueError as error:
            self._unreadable = str(error)
            return
        sec, nanosec = _STAMP.unpack_from(data, _HEAD)
        self._answers.append((command, sec + 1e-9 * nanosec))

    def _on_status(self, message: msg.ControllerStatus) -> None:
        self._status = message

    def _on_beat(self, message: msg.Alive) -> None:
        if message.role != "plant":  # its own
            self._beats.setdefault(message.node, []).append((message, monotonic()))

    def _deaf(self) -> str:
        """Return which QoS keeps it and a bench from hearing each other, in words."""
        node, found = self._node, list[str]()
        for topic in (topics.CONTROLLER_STATUS, topics.EFFORT_COMMAND):
            for info in node.get_publishers_info_by_topic(node.resolve_topic_name(topic)):
                offered, table = info.qos_profile, topics.TOPICS[topic]
                if offered.reliability is ReliabilityPolicy.BEST_EFFORT:
                    found.append(f"it offers {topic} as best effort, a bench requests reliable")
                elif table.latched and offered.durability is DurabilityPolicy.VOLATILE:
                    found.append(f"it offers {topic} as volatile, a bench requests transient local")
        for info in node.get_subscriptions_info_by_topic(self._ask.topic_name):
            if info.qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL:
                found.append("it requests measurement as transient local, which is volatile")
        return "".join(f"; {words}" for words in found)
