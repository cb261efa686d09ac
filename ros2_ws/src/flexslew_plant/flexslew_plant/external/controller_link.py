"""A program or board as the controller: what the bench sends it, and what it answers.

The messages are those of an external plant with the roles transportd: the bench sends
MEASUREMENT, the board answers EFFORT with the same epoch and tick. RESET restarts its memory.
"""

from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.external.messages import (
    PROTOCOL,
    MessageKind,
    PlantFault,
    encoded,
    json_bytes,
    json_of,
    number_bytes,
    numbers_of,
)
from flexslew_plant.external.transport import Transport, answer_to


class ControllerHello(NamedTuple):
    """What a board receives first."""

    period: float  # one tick [s]
    joints: tuple[str, ...]
    tips: tuple[str, ...]
    effort_limit: tuple[float, ...]  # of each motor [N m or N]


class RemoteController:
    """A program or board that answers.

    Args:
        transport: to it.
        hello: for it.

    Attributes:
        numbers: how many it receives per tick.
        name: as it describes itself.

    Raises:
        PlantFault: it does not answer, or is not made for this testbed.
    """

    def __init__(self, transport: Transport, hello: ControllerHello) -> None:
        self._transport, self._efforts = transport, len(hello.effort_limit)
        self.numbers = 4 * len(hello.joints) + 2 * (len(hello.tips) + self._efforts)
        body = json_bytes({"protocol": PROTOCOL, **hello._asdict()})
        answer = answer_to(
            transport, encoded(MessageKind.HELLO, body=body), MessageKind.DESCRIPTION, 0, 0
        )
        try:
            described = json_of(answer.body)
        except PlantFault as error:
            raise PlantFault(f"{transport.name}: its description: {error}") from None
        expected = {"protocol": PROTOCOL, "numbers": self.numbers, "efforts": self._efforts}
        for key, value in expected.items():
            if described.get(key) != value:
                words = f"the controller describes {key} {described.get(key)!r}; {value} is needed"
                raise PlantFault(f"{transport.name}: {words}")
        self.name = str(described.get("name", transport.name))

    def reset(self, epoch: int, tick: int, effort: Vector) -> None:
        """Restart its memory, before its first answer in an epoch or takeover.

        Args:
            epoch: of the tick.
            tick: that it answers next.
            effort: effort applied during the last tick, from which it takes over [N m or N].

        Raises:
            PlantFault: no such answer.
        """
        question = encoded(MessageKind.RESET, epoch, tick, number_bytes(effort))
        answer_to(self._transport, question, MessageKind.RESET, epoch, tick)

    def close(self) -> None:
        """End the program, or give the line back."""
        self._transport.close()

    def efforts(self, epoch: int, tick: int, numbers: Vector) -> Vector:
        """Return the efforts for the coming tick, shape (efforts,) [N m or N].

        Args:
            epoch: of the tick.
            tick: of the measurement.
            numbers: positions, velocities, tips, root curvatures, applied efforts, then positions,
                velocities and efforts of the reference.

        Raises:
            PlantFault: no such answer.
        """
        if numbers.size != self.numbers:
            raise BadInput(f"{numbers.size} numbers; the controller expects {self.numbers}")
        question = encoded(MessageKind.MEASUREMENT, epoch, tick, number_bytes(numbers))
        answer = answer_to(self._transport, question, MessageKind.EFFORT, epoch, tick)
        try:
            return np.array(numbers_of(answer.body, self._efforts))
        except PlantFault as error:
            words = f"its efforts of tick {tick} of epoch {epoch}: {error}"
            raise PlantFault(f"{self._transport.name}: {words}") from None
