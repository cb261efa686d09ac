"""Whether an external controller keeps the lock-step, under the questions of a bad day.

The rules are those of docs/any_language.md. The bench here sways a little for any command: the
examination covers the ticks and times of answers, not their quality.
"""

from collections.abc import Callable
from contextlib import suppress
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
from flexslew_plant.bench.operation.presence import HEARTBEAT_TIMEOUT
from flexslew_plant.bench.wire import command_from, measurement_bytes
from flexslew_plant.errors import BadInput
from flexslew_plant.graph import topics
from flexslew_plant.measurement import EffortCommand, Measurement
from flexslew_plant.message_codec import leading
from flexslew_plant.network import require_loopback
from flexslew_plant.processes.atomic import atomic
from flexslew_plant.ros.alive import Alive
from flexslew_plant.ros.messages import message_of, stamp
from flexslew_plant.ros.offers import publisher, subscription
from flexslew_plant.ros.start import start_ros

_LOCK_STEP_TICKS = 200  # in lock-step
_BATCH = 5  # questions sent without waiting for answers
_FAR = 3000  # ticks by which a stray question is ahead
_QUIET = 0.3  # in which an answer that must not come would have come [wall s]
_AMPLITUDE = 1e-3  # of the joints, at 1 rad/s [rad or m]
_RESET_TICKS = 3  # ticks after a reset that are answered as at the start
_OTHER_CONTROLLER, _NO_CONTROLLER = "somebody_else", ""  # the drive brakes
_MAX_QUEUE = 900  # questions after which a bench would soon wait for a controller that reports none
_STAMP = leading("flexslew_msgs/msg/EffortCommand", "stamp.sec", "stamp.nanosec")
_MIDDLE, _REPEATS = 50, 3  # questions to others before and after one to it, while it is stopped
_MAX_DELAY, _LATE = 60.0, 1.0  # by which `since` may be before the examination, and after now [s]
_DEPTH = (
    "an estimator takes every question, so measurement is subscribed with a depth of "
    f"{topics.LOOP_DEPTH}"
)
_PROCESS_STOPPED = "its process has ended"


class RuleResult(NamedTuple):
    """What became of one rule."""

    rule: str
    wrong: str  # in words; empty: it is kept

    @property
    def ok(self) -> bool:
        """It is kept."""
        return not self.wrong


class Wrong(Exception):
    """A rule is broken, in words."""


class InterfaceTest:
    """A plant that sends its questions to one controller.

    Args:
        bench: bench with the announced testbed.
        patience: for anything that must come [wall s].
        running: returns whether the controller's process still runs.
        restart: ends the process and starts another one; returns what was wrong, or "".
        stop: stops the process (True), or lets it go on.
    """

    def __init__(
        self,
        bench: Bench,
        patience: float,
        running: Callable[[], bool],
        restart: Callable[[], str],
        stop: Callable[[bool], None],
    ) -> None:
        self._bench, self._patience, self._running = bench, patience, running
        self._restart, self._stop = restart, stop
        self._start_time = time_ns()
        # the arguments of this process are those of the controller
        start_ros(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self._node = node = rclpy.create_node("plant")
        self._executor = EventsExecutor()
        self._executor.add_node(node)
        require_loopback()
        self._alive = Alive(node, "plant")
        self._publisher = publisher(node, topics.MEASUREMENT)
        self._state = publisher(node, topics.BENCH_STATE)
        self._commands: list[tuple[EffortCommand, float]] = []  # with the stamp [s]
        self._decode_error = ""  # what is wrong with the newest answer
        self._status: msg.ControllerStatus | None = None
        self._heartbeats: dict[
            str, list[tuple[msg.Alive, float]]
        ] = {}  # by node, with the wall time
        self._before: list[np.ndarray] = []  # efforts of the first epoch in lock-step, by tick
        self._last_tick = -1  # tick of this epoch
        subscription(node, topics.EFFORT_COMMAND, self._on_command, raw=True)
        subscription(node, topics.CONTROLLER_STATUS, self._on_status)
        subscription(node, topics.ALIVE, self._on_heartbeat)
        self._testbed = publisher(node, topics.TESTBED)
        self._epoch, self._tick = 0, -1
        self._who = ""

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown()

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
            except Wrong as error:
                wrong = str(error)
            if not self._running():
                wrong = _PROCESS_STOPPED
            found.append(RuleResult(rule, wrong))
            if wrong == _PROCESS_STOPPED or (wrong and len(found) == 1):
                break
            if wrong:  # what still comes is not taken for an answer to the next rule
                with suppress(Wrong):
                    self._spin(_QUIET)
        return found

    def _check_ready(self) -> None:
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
            lambda: self._publisher.get_subscription_count() > 0, "measurement has no subscription"
        )
        if early:
            raise Wrong("it reports ready before a testbed is announced; reason must state why not")
        requested = self._node.get_subscriptions_info_by_topic(self._publisher.topic_name)
        if any(one.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT for one in requested):
            raise Wrong(
                "it subscribes to measurement as best effort, so that questions get lost: reliable"
            )

    def _check_heartbeat(self) -> None:
        self._require_heartbeats(3.0 * HEARTBEAT_TIMEOUT)

    def _require_heartbeats(self, seconds: float) -> None:
        """Listen to its signs of life for so long [wall s]."""
        self._heartbeats.clear()
        start = monotonic()
        self._spin(seconds)
        heartbeats = self._heartbeats.get(self._who, [])
        if not heartbeats:
            others = ", ".join(self._heartbeats) or "nobody"
            raise Wrong(f"no heartbeat of {self._who} on alive; received: {others}")
        if roles := {heartbeat.role for heartbeat, _ in heartbeats} - {"controller"}:
            raise Wrong(f"its role on alive is {min(roles)!r}; it must be 'controller'")
        if len(instances := {heartbeat.instance for heartbeat, _ in heartbeats}) > 1:
            raise Wrong("its instance on alive changes; a process draws it once")
        if instances == {0}:
            raise Wrong("its instance on alive is 0; a process draws it, or two count as one")
        self._check_start_time([heartbeat.since for heartbeat, _ in heartbeats])
        if self._status is not None and self._status.instance not in instances:
            raise Wrong(
                f"its instance is {min(instances)} on alive, {self._status.instance} in its "
                "controller_status; it must be the same"
            )
        max_gap = float(np.diff([start, *(at for _, at in heartbeats), monotonic()]).max())
        if max_gap > HEARTBEAT_TIMEOUT:
            raise Wrong(
                f"silent for {max_gap:.2f} s; after {HEARTBEAT_TIMEOUT:g} s it counts as gone"
            )

    def _check_start_time(self, since: list[int]) -> None:
        """Refuse a date of the start that would make it older than every namesake."""
        if len({*since}) > 1:
            raise Wrong("its since on alive changes; it is when the process started")
        early, late = self._start_time - int(1e9 * _MAX_DELAY), time_ns() + int(1e9 * _LATE)
        if not early <= since[0] <= late:
            raise Wrong(
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
        self._spin(_QUIET)
        for command, at in self._commands:
            self._check(command, at, self._tick)
            if not np.array_equal(command.effort, first.effort):
                raise Wrong(f"tick {self._tick} repeated: another effort than the first time")
        if len(self._commands) > 1:
            raise Wrong(f"tick {self._tick} repeated: {len(self._commands)} answers")

    def _swap(self) -> None:
        self._commands.clear()
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
        self._commands.clear()
        begin = self._tick + 1
        for tick in range(begin, begin + _BATCH):
            self._send_query(tick)
        last = begin + _BATCH - 1
        self._until(
            lambda: any(c.tick == last for c, _ in self._commands),
            f"no answer to tick {last}, the last of {_BATCH} sent one after the other",
        )
        self._spin(_QUIET)
        ticks = [command.tick for command, _ in self._commands]
        for command, at in self._commands:
            self._check(command, at, command.tick)
        if ticks != sorted(set(ticks)) or not set(ticks) <= set(range(begin, last + 1)):
            raise Wrong(f"ticks {begin} to {last} were sent, {ticks} answered")

    def _check_wrong_tick(self) -> None:
        self._commands.clear()
        true_tick = self._tick
        self._send_query(true_tick + _FAR)
        self._spin(_QUIET)
        self._commands.clear()
        self._query(true_tick + 1)

    def _pause(self) -> None:
        self._commands.clear()
        self._publish_state("paused")
        try:
            self._require_heartbeats(2.0 * HEARTBEAT_TIMEOUT)
        except Wrong as error:
            raise Wrong(f"while the bench is paused: {error}") from None
        if self._commands:
            raise Wrong(f"{len(self._commands)} answers without a question")
        self._ready("while the bench is paused")
        self._publish_state("running")
        self._query(self._tick + 1)

    def _reset(self) -> None:
        self._begin_epoch()
        for tick in range(_RESET_TICKS):
            effort = self._query(tick).effort
            if tick < len(self._before) and not np.array_equal(effort, self._before[tick]):
                raise Wrong(
                    f"tick {tick} of the new epoch: another effort than at the start, where the "
                    "question was the same; a controller restarts"
                )
        self._check_last_tick(0)

    def _check_queue(self) -> None:
        """Ask as in lock-step, but at once: what has memory answers the last one alike."""
        self._begin_epoch()
        self._query(0)
        self._commands.clear()
        last = _LOCK_STEP_TICKS - 1
        for tick in range(1, _LOCK_STEP_TICKS):
            self._send_query(tick)
        self._until(
            lambda: any(c.tick == last for c, _ in self._commands),
            f"no answer to tick {last}, the last of {_LOCK_STEP_TICKS} sent one after the other",
        )
        effort = next(c.effort for c, _ in self._commands if c.tick == last)
        if len(self._before) == _LOCK_STEP_TICKS and not np.array_equal(effort, self._before[last]):
            raise Wrong(
                f"tick {last} of questions that piled up: another effort than where each was "
                f"waited for; {_DEPTH}"
            )
        for _ in range(_REPEATS):
            self._check_stopped_process()

    def _check_stopped_process(self) -> None:
        """Send questions while its process is stopped: one to it between many to others."""
        requested = self._tick + _MIDDLE + 1
        self._commands.clear()
        self._stop(True)
        try:
            for _ in range(2 * _MIDDLE + 1):
                self._send_query(
                    self._tick + 1, None if self._tick + 1 == requested else _OTHER_CONTROLLER
                )
            self._spin(_QUIET)
        finally:
            self._stop(False)
        self._until(
            lambda: bool(self._commands),
            f"no answer to tick {requested}, one of {2 * _MIDDLE + 1} that came while it was "
            "stopped; "
            f"{_DEPTH}",
        )
        command, at = self._commands.pop(0)
        self._check(command, at, requested)

    def _check_new_process(self) -> None:
        """Compare what two processes of the same command have drawn."""
        instances = {heartbeat.instance for heartbeat, _ in self._heartbeats.get(self._who, [])}
        if not instances:
            raise Wrong(f"no heartbeat of {self._who} on alive")
        ignored = self._restart()
        self._spin(_QUIET)  # the last ones of the process that has ended
        self._heartbeats.clear()
        self._until(
            lambda: self._who in self._heartbeats, f"no heartbeat of {self._who} after a start"
        )
        if repeated := instances & {
            heartbeat.instance for heartbeat, _ in self._heartbeats[self._who]
        }:
            raise Wrong(
                f"its instance on alive is {min(repeated)} after a new start, too; each process "
                "draws "
                "its own, or one that comes back counts as its predecessor"
            )
        if ignored:
            raise Wrong(ignored)

    def _begin_epoch(self) -> None:
        self._epoch += 1
        self._tick = self._last_tick = -1
        self._publish_state("running")

    def _check_last_tick(self, least: int) -> None:
        """Ask on until the status has a tick of this epoch, from `least` on."""

        def has_status() -> bool:
            status = self._status
            assert status is not None
            return bool(status.epoch == self._epoch and least <= status.last_tick <= self._tick)

        self._spin(_QUIET)
        while not has_status() and self._tick < _MAX_QUEUE:
            self._query(self._tick + 1)
        self._spin(_QUIET)
        if not has_status():
            assert self._status is not None
            raise Wrong(
                f"after tick {self._tick} of epoch {self._epoch} its controller_status has tick "
                f"{self._status.last_tick} of epoch {self._status.epoch}; a bench waits for a "
                "controller that is 1,000 ticks behind"
            )

    def _query(self, tick: int) -> EffortCommand:
        """Ask, and return the one answer."""
        self._commands.clear()
        self._send_query(tick)
        self._until(lambda: bool(self._commands), f"no answer to tick {tick}")
        command, at = self._commands.pop(0)
        self._check(command, at, tick)
        self._last_tick = tick
        return command

    def _check(self, command: EffortCommand, at: float, tick: int) -> None:
        """Refuse an answer that a bench would reject."""
        where = f"answer to tick {tick} of epoch {self._epoch}"
        if (command.tick, command.epoch) != (tick, self._epoch):
            if command.epoch == self._epoch and command.tick == self._last_tick:
                raise Wrong(f"tick {command.tick} of epoch {command.epoch} is answered twice")
            raise Wrong(f"{where}: it has tick {command.tick} of epoch {command.epoch}")
        if command.controller != self._who:
            raise Wrong(f"{where}: controller is {command.controller!r}, not {self._who!r}")
        size = self._bench.model.efforts
        if command.effort.shape != (size,):
            raise Wrong(f"{where}: {command.effort.size} efforts; the bench has {size} actuators")
        if not np.isfinite(command.effort).all():
            raise Wrong(f"{where}: an effort is not finite")
        told = {heartbeat.instance for heartbeat, _ in self._heartbeats.get(self._who, [])}
        if told and command.instance not in {0, *told}:
            raise Wrong(
                f"{where}: its instance is {command.instance}, on alive {min(told)}; a bench takes "
                "it for another process of that name"
            )
        expected = tick * self._bench.settings.period
        if abs(at - expected) > 1e-9:
            raise Wrong(f"{where}: its stamp is {at:.9g} s; that of the question is {expected:.9g}")

    def _require_no_command(self, when: str) -> None:
        self._spin(_QUIET)
        if self._commands:
            raise Wrong(f"{len(self._commands)} answers {when}")

    def _ready(self, when: str) -> None:
        """Refuse a controller that could not take charge."""
        if self._status is not None and not self._status.ready:
            raise Wrong(f"not ready {when}: {self._status.reason}")

    def _send_query(self, tick: int, who: str | None = None) -> None:
        """Ask a question; None: the controller itself."""
        model, appendages = self._bench.model, len(self._bench.appendages.names)
        at, tips = tick * self._bench.settings.period, np.zeros(appendages)
        phase = at + np.arange(model.joints)
        self._tick, zero_effort = tick, np.zeros(model.efforts)
        question = Measurement(
            tick,
            self._epoch,
            at,
            self._who if who is None else who,
            _AMPLITUDE * np.sin(phase),
            _AMPLITUDE * np.cos(phase),
            tips,
            tips,
            zero_effort,
        )
        self._publisher.publish(measurement_bytes(question))

    def _publish_state(self, state: str) -> None:
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
                raise Wrong(_PROCESS_STOPPED)
            if monotonic() > end:
                words = otherwise if isinstance(otherwise, str) else otherwise()
                raise Wrong(f"{words} within {self._patience:g} s{self._qos_mismatch()}")
            self._spin_once(0.05)

    def _spin(self, seconds: float) -> None:
        end = monotonic() + seconds
        while (left := end - monotonic()) > 0.0:
            self._spin_once(min(left, 0.05))

    def _spin_once(self, timeout: float) -> None:
        self._alive.poll(monotonic())
        with atomic:  # as a node's loop does
            self._executor.spin_once(timeout_sec=timeout)
        if self._decode_error:
            words, self._decode_error = self._decode_error, ""
            raise Wrong(f"a bench cannot read its answer: {words}")

    def _on_command(self, data: bytes) -> None:
        try:
            command = command_from(data)
        except BadInput as error:
            self._decode_error = str(error)
            return
        sec, nanosec = _STAMP.unpack_from(data)
        self._commands.append((command, sec + 1e-9 * nanosec))

    def _on_status(self, message: msg.ControllerStatus) -> None:
        self._status = message

    def _on_heartbeat(self, message: msg.Alive) -> None:
        if message.role != "plant":  # its own
            self._heartbeats.setdefault(message.node, []).append((message, monotonic()))

    def _qos_mismatch(self) -> str:
        """Return which QoS keeps it and a bench from hearing each other, in words."""
        node, found = self._node, list[str]()
        for topic in (topics.CONTROLLER_STATUS, topics.EFFORT_COMMAND):
            for info in node.get_publishers_info_by_topic(node.resolve_topic_name(topic)):
                offered, table = info.qos_profile, topics.TOPICS[topic]
                if offered.reliability is ReliabilityPolicy.BEST_EFFORT:
                    found.append(f"it offers {topic} as best effort, a bench requests reliable")
                elif table.latched and offered.durability is DurabilityPolicy.VOLATILE:
                    found.append(f"it offers {topic} as volatile, a bench requests transient local")
        for info in node.get_subscriptions_info_by_topic(self._publisher.topic_name):
            if info.qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL:
                found.append("it requests measurement as transient local, which is volatile")
        return "".join(f"; {words}" for words in found)
