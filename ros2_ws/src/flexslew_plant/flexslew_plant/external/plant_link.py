"""The bench's end of the exchange with an external plant: one question, one answer."""

from collections import deque
from contextlib import suppress
from time import perf_counter
from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import Vector
from flexslew_plant.events import Fact, WallTimes
from flexslew_plant.external.description import section_of
from flexslew_plant.external.messages import (
    PROTOCOL,
    Message,
    MessageKind,
    PlantFault,
    encoded,
    json_bytes,
    json_of,
    number_bytes,
    numbers_of,
    text_of,
)
from flexslew_plant.external.transport import Transport, answer_to
from flexslew_plant.step_times import StepTimes

BRAKE_TIMEOUT = 1.0  # longest wait for the answer to BRAKE [wall s]


class Hello(NamedTuple):
    """What a plant receives first."""

    period: float  # one tick [s]
    parameters: dict[str, float]  # in the units of the plant
    initial: dict[str, float]  # joint positions at the start, by name [rad or m]


class PlantLink:
    """A running plant; see testbeds.contract.RunningPlant.

    Args:
        transport: to the plant, before any message.
        hello: for it.

    Attributes:
        described: the keys of a testbed section that its description gives.
        period: of its own clock [s]; None: it has none.
        facts: what it has to note in the log; its reader empties it.

    Raises:
        PlantFault: if it does not describe itself as the protocol requires.
    """

    def __init__(self, transport: Transport, hello: Hello) -> None:
        self._transport = transport
        self._epoch, self._tick = -1, 0
        self._brakes = self._moves = False  # whether it has a brake, and was reset since it braked
        self._times, self.facts = StepTimes(), deque[Fact]()
        try:
            body = json_bytes({"protocol": PROTOCOL, **hello._asdict()})
            question = encoded(MessageKind.HELLO, body=body)
            answer = answer_to(transport, question, MessageKind.DESCRIPTION, 0, 0)
            try:
                description = json_of(answer.body)
                self.described = section_of(description)
            except PlantFault as error:
                raise self._fault(f"its description: {error}") from None
        except PlantFault:
            self.close()
            raise
        self._brakes = description.get("brake", False)
        self.period: float | None = description.get("period")
        joints, tips = len(self.described["joints"]), len(self.described["tips"])
        self._joints, self._tips = joints, tips
        self._rates = bool(self.described["tip_rates"])
        self._count = 2 * joints + (2 if self._rates else 1) * tips

    @property
    def name(self) -> str:
        """Name of the plant, for errors."""
        return self._transport.name

    @property
    def timeout(self) -> float:
        """Time limit of an answer [wall s]."""
        return self._transport.timeout

    def set_timeout(self, timeout: float) -> None:
        """Set the time limit of an answer [wall s]."""
        self._transport.set_timeout(timeout)

    def reset(self) -> Vector:
        """Return to tick 0 of the next epoch; return the state there.

        Raises:
            PlantFault: no such answer.
        """
        self._epoch, self._tick = self._epoch + 1, 0
        self._moves = True
        return self._state(encoded(MessageKind.RESET, self._epoch))

    def advance(self, effort: Vector) -> Vector:
        """Return the state a period later with the efforts held, shape (joints,) [N m or N].

        Raises:
            PlantFault: no such answer; its brake was requested.
        """
        question = encoded(MessageKind.EFFORT, self._epoch, self._tick, number_bytes(effort))
        self._tick += 1
        began = perf_counter()
        try:
            state = self._state(question)
        except PlantFault as error:
            raise self.braked(error) from None
        self._times.add(perf_counter() - began)
        return state

    def send(self, effort: Vector, tick: int) -> None:
        """Send the efforts of a tick to a plant with a clock of its own.

        Raises:
            PlantFault: it takes nothing, or is gone.
        """
        self._tick = tick
        self._transport.send(encoded(MessageKind.EFFORT, self._epoch, tick, number_bytes(effort)))

    def measurement(self, timeout: float) -> tuple[int, Vector] | None:
        """Return tick and state of the next measurement of a plant with a clock of its own.

        None: none has come within the time [wall s].

        Raises:
            PlantFault: it reports that it cannot go on, or is gone.
        """
        while (message := self._transport.receive(timeout)) is not None:
            if message.kind == MessageKind.ERROR:
                raise self._fault(f"reports: {text_of(message.body)}")
            if (message.kind, message.epoch) == (MessageKind.MEASUREMENT, self._epoch):
                return message.tick, self._state_of(message)
        return None

    def stop(self) -> None:
        """Brake a plant that has a brake, and note its times; a second call changes nothing.

        Raises:
            PlantFault: the brake is not acknowledged.
        """
        self.note_times("step", self._times)
        self._times = StepTimes()
        if not (self._brakes and self._moves):
            return
        self._moves = False
        key, timeout = (self._epoch, self._tick), self.timeout
        self.set_timeout(min(timeout, BRAKE_TIMEOUT))
        try:
            answer_to(self._transport, encoded(MessageKind.BRAKE, *key), MessageKind.BRAKE, *key)
        except PlantFault as error:
            raise PlantFault(f"its brake is not acknowledged: {error}") from None
        finally:
            self.set_timeout(timeout)

    def braked(self, fault: PlantFault) -> PlantFault:
        """Request the brake after a fault; return the fault with what became of it."""
        if not (self._brakes and self._moves):
            return fault
        try:
            self.stop()
        except PlantFault:
            return PlantFault(f"{fault}; its brake is not acknowledged")
        return PlantFault(f"{fault}; its brake is on")

    def note_times(self, quantity: str, times: StepTimes) -> None:
        """Note a summary of times in the log, if there are any."""
        if (summary := times.summary()) is not None:
            self.facts.append(WallTimes(quantity, *summary))

    def close(self) -> int | None:
        """Brake and end the plant; return its exit status, None if it had to be killed."""
        with suppress(PlantFault):
            self.stop()
        return self._transport.close()

    def _state(self, question: bytes) -> Vector:
        """Return [positions, tips, velocities, rates of the tips] of the answer to a question."""
        kind = MessageKind.MEASUREMENT
        return self._state_of(answer_to(self._transport, question, kind, self._epoch, self._tick))

    def _state_of(self, measurement: Message) -> Vector:
        """Return [positions, tips, velocities, rates of the tips] of a measurement."""
        try:
            numbers = numbers_of(measurement.body, self._count)
        except PlantFault as error:
            raise self._fault(f"its measurement of tick {measurement.tick}: {error}") from None
        n, m = self._joints, self._tips
        state = np.zeros(2 * (n + m))
        state[:n], state[n + m : 2 * n + m] = numbers[:n], numbers[n : 2 * n]
        state[n : n + m] = numbers[2 * n : 2 * n + m]
        if self._rates:
            state[2 * n + m :] = numbers[2 * n + m :]
        return state

    def _fault(self, words: str) -> PlantFault:
        return PlantFault(f"{self._transport.name}: {words}")
