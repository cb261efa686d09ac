"""The `plant` node: the bench behind topics and services. It owns time."""

from time import monotonic
from typing import Any

from flexslew_msgs import msg

from flexslew_plant import topics
from flexslew_plant.bench.backlog import Standby
from flexslew_plant.bench.bench import Bench, BenchSettings
from flexslew_plant.bench.events import Event, Level
from flexslew_plant.bench.pacing import Pacing
from flexslew_plant.bench.wire import command_from, measurement_bytes
from flexslew_plant.ros.display import Display
from flexslew_plant.ros.node import (
    LOOP,
    Loop,
    doubles,
    event_message,
    latched,
    new_node,
    run_node,
    settings_of,
    stamp,
    unmatched,
    wait_until_heard,
)
from flexslew_plant.ros.plant_services import Services
from flexslew_plant.settings import NonNegative, Positive, plain, section, yaml_text


@section
class PlantSettings:
    """The parameters of the node."""

    bench: BenchSettings = BenchSettings()
    rate_factor: NonNegative = 0.0  # 0: as fast as it goes, 1: real time
    answer_timeout: Positive = 2.0  # silence that counts as missed ticks, not paced [wall s]
    controllers: tuple[str, ...] = ()  # standbys that must be ready before tick 0, too
    wait_for: tuple[str, ...] = ()  # recorders: nodes that must hear everything from tick 0 on
    autostart: bool = True  # start when all are there; else the service does
    exit_when_done: bool = False  # end the process after the last tick
    truth: bool = True  # publish the true state every tick
    progress: bool = False  # print the tick twice a wall second, for the one who started this node
    display_rate: NonNegative = 50.0  # joint states, tf, markers, clock [1/simulated s]; 0: none


class Plant:
    """Asks on `measurement`, takes answers from `effort_command`."""

    def __init__(self, loop: Loop) -> None:
        self.loop = loop
        self.node = node = new_node("plant")
        loop.add(node)
        self._settings: PlantSettings = settings_of(node, PlantSettings)
        self.bench = Bench(self._settings.bench)
        self.bench.truth()  # loads its machine code before a tick needs it
        self._pacing = Pacing(
            self._settings.bench.period, self._settings.rate_factor, self._settings.answer_timeout
        )
        self.state = "waiting" if self._settings.autostart else "paused"
        self._steps_left = 0
        self._shown = (0, -1)  # epoch and tick of the newest truth that was published
        self._waiting_for: list[str] = []
        self._started = self._next_progress = monotonic()
        self.controllers: dict[str, msg.ControllerStatus] = {}
        self.standby = Standby(patience=self._settings.answer_timeout, paced=self._pacing.paced)

        self._measurement = node.create_publisher(msg.Measurement, topics.MEASUREMENT, LOOP)
        self._truth = node.create_publisher(msg.PlantState, topics.TRUTH, LOOP)
        self._events = node.create_publisher(msg.Event, topics.EVENTS, latched(1000))
        self._testbed = node.create_publisher(msg.Testbed, topics.TESTBED, latched(1))
        self._display = Display(node, self.bench, self._settings.display_rate)
        node.create_subscription(
            msg.EffortCommand, topics.EFFORT_COMMAND, self._on_command, LOOP, raw=True
        )
        node.create_subscription(
            msg.ControllerStatus, topics.CONTROLLER_STATUS, self._on_status, latched(100)
        )
        node.create_subscription(
            msg.RecorderStatus, topics.RECORDER_STATUS, self._on_recorder, latched(10)
        )
        self._services = Services(self, loop)
        self._testbed.publish(self._testbed_message())

    def poll(self) -> float:
        """Do what is due; return the wall seconds until something can be due again."""
        self._services.poll()
        if self.state == "waiting":
            self._try_start()
            return 0.0 if self.state == "running" else 0.02
        if self.state != "running":
            return 0.5
        now, bench = monotonic(), self.bench
        if self._settings.progress and now >= self._next_progress:
            print(f"tick {bench.tick} of {bench.last_tick}", flush=True)
            self._next_progress = now + 0.5
        if self._pacing.tick_over(now, bench.answered, bench.drive.missed_in_a_row):
            if self._held_back(now):
                return 0.005
            self._advance()
        elif not bench.answered and self._pacing.repeat_due(now):
            self._measurement.publish(measurement_bytes(bench.question))
        return 0.0 if bench.answered and not self._pacing.paced else self._pacing.wait(monotonic())

    def close(self) -> None:
        """Say goodbye, whole."""
        if self.state in ("running", "paused") and self.bench.tick:
            self._say(Level.WARNING, "interrupted", f"stopped at tick {self.bench.tick}")
            wait_until_heard(self.node)
        self.node.destroy_node()

    def _missing(self) -> list[str]:
        """Return whom the start has to wait for, and why."""
        active = self.bench.drive.active
        crew = {*self._settings.controllers, active} if active else set()
        missing = set(unmatched(self.node, [self._measurement], sorted(crew)))
        for name in crew:
            status = self.controllers.get(name)
            if status is None or not status.ready:
                why = "not announced" if status is None else status.reason
                missing = {*missing - {name}, f"{name} ({why})"}
        heard = [self._measurement] + [self._truth] * self._settings.truth
        return sorted({*missing, *unmatched(self.node, heard, self._settings.wait_for)})

    def _try_start(self) -> None:
        missing = self._missing()
        if missing:
            if missing != self._waiting_for:
                self.node.get_logger().info(f"waiting for {', '.join(missing)}")
                self._waiting_for = missing
            return
        self.state = "running"
        self._started = monotonic()
        self._pacing.start(self._started)
        word = "started" if self.bench.tick == 0 else "resumed"
        self._say(Level.INFO, word, f"{word} at tick {self.bench.tick}")
        self._publish_tick()

    def _on_command(self, data: bytes) -> None:
        if self.state != "running":
            return
        taken = self.bench.offer(command_from(data))
        if taken and not self._pacing.paced:
            if self._held_back(monotonic()):
                self.loop.hurry()
            else:
                self._advance()
        elif self.bench.events:
            self._publish_events()
            if not self.bench.answered:  # a refused switch asks its predecessor
                self._measurement.publish(measurement_bytes(self.bench.question))

    def _held_back(self, now: float) -> bool:
        """Return whether a standby is too far behind for another question."""
        return bool(self.standby.slow(self.bench.tick + 1, self.bench.epoch, now))

    def _advance(self) -> None:
        self.bench.advance()
        if self.bench.done:
            self._finish()
        else:
            self._pacing.asked(monotonic())
            self._publish_tick()
            if self.bench.switch_results or not self.bench.drive.active:
                self.loop.hurry()
            if self._steps_left:
                self._steps_left -= 1
                if not self._steps_left:
                    self.state = "paused"

    def _publish_tick(self) -> None:
        """Ask first: the answer is under way while the rest goes out."""
        self._measurement.publish(measurement_bytes(self.bench.question))
        self._publish_truth()
        self._publish_events()

    def _publish_truth(self) -> None:
        truth = self.bench.truth()
        if (truth.epoch, truth.tick) == self._shown:  # resumed: only the question is repeated
            return
        self._shown = truth.epoch, truth.tick
        if self._settings.truth:
            message = msg.PlantState(
                tick=truth.tick,
                epoch=truth.epoch,
                position=doubles(truth.position),
                velocity=doubles(truth.velocity),
                applied_effort=doubles(truth.applied_effort),
                disturbance=doubles(truth.disturbance),
                tip_deflection=doubles(truth.tip_deflection),
                energy=truth.energy,
            )
            message.header.stamp = stamp(truth.time)
            self._truth.publish(message)
        self._display.show(truth)

    def _publish_events(self) -> None:
        while self.bench.events:
            event = self.bench.events.popleft()
            self._events.publish(event_message(event))
            words = f"t = {event.time:.2f} s: {event.message}"
            # rclpy ties a severity to the line of the call
            if event.level == Level.INFO:
                self.node.get_logger().info(words)
            elif event.level == Level.WARNING:
                self.node.get_logger().warning(words)
            else:
                self.node.get_logger().error(words)

    def _finish(self) -> None:
        self.state = "finished"
        self._publish_truth()
        wall = monotonic() - self._started
        bench = self.bench
        self._say(
            Level.INFO,
            "finished",
            f"{bench.tick} ticks in {wall:.2f} s wall, {bench.drive.missed} missed",
            {
                "wall_time": wall,
                "ticks": bench.tick,
                "missed_ticks": bench.drive.missed,
                "saturated_time": bench.saturated_ticks * self._settings.bench.period,
                "rejected": dict(bench.drive.rejected),
            },
        )
        if bench.failure:
            print(f"error: {bench.failure}", flush=True)  # for the one who started this node
        if self._settings.exit_when_done:
            self.loop.stop(3 if bench.faulted else 0)

    def _say(
        self, level: Level, kind: str, message: str, data: dict[str, Any] | None = None
    ) -> None:
        bench = self.bench
        bench.events.append(
            Event(bench.tick, bench.time, bench.epoch, level, "plant", kind, message, data or {})
        )
        self._publish_events()

    def _on_status(self, message: msg.ControllerStatus) -> None:
        self.controllers[message.controller] = message
        self.standby.heard(message.controller, message.last_tick, message.epoch)
        if self.state == "running":
            self.bench.note_readiness(message.controller, message.reason)
            self._publish_events()

    def _on_recorder(self, message: msg.RecorderStatus) -> None:
        self.standby.heard(message.recorder, message.tick, message.epoch)

    def start(self) -> tuple[bool, str]:
        """Start or resume as soon as all are there; return whether, and words."""
        if self.state == "finished":
            return False, "the run is over; call reset first"
        if self.state == "running":
            return False, "already running"
        self.state = "waiting"
        self.loop.hurry()
        return True, f"starting at tick {self.bench.tick}"

    def pause(self) -> tuple[bool, str]:
        """Stop between two ticks; return whether, and words."""
        if self.state not in ("running", "waiting"):
            return False, f"not running but {self.state}"
        self.state = "paused"
        words = f"paused at tick {self.bench.tick}"
        self._say(Level.INFO, "paused", words)
        return True, words

    def reset(self) -> tuple[bool, str]:
        """Return to tick 0 in a new epoch and pause there; return whether, and words."""
        self.bench.reset()
        self.state = "paused"
        words = f"reset, epoch {self.bench.epoch}; call start"
        self._say(Level.INFO, "reset", words)
        return True, words

    def step(self, ticks: int) -> tuple[bool, str]:
        """Fly some ticks of a paused bench; return whether, and words."""
        if self.state != "paused":
            return False, f"not paused but {self.state}; call pause first"
        self._steps_left = max(1, ticks)
        self.state = "waiting"
        self.loop.hurry()
        return True, f"flying {self._steps_left} ticks"

    def _testbed_message(self) -> msg.Testbed:
        bench, settings = self.bench, self._settings
        return msg.Testbed(
            kind=settings.bench.testbed.kind,
            joint_names=list(bench.model.joint_names),
            joint_units=list(bench.model.joint_units),
            appendage_names=list(bench.appendages.names),
            modes=bench.model.modes,
            period=settings.bench.period,
            effort_limit=doubles(bench.limit),
            settings=yaml_text(plain(settings)),
        )


def main() -> None:
    """Run the node until it is done or interrupted."""
    run_node(Plant)


if __name__ == "__main__":
    main()
