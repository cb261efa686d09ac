"""The exchange of whole messages with another program or device: one question, one answer."""

from typing import Protocol

from flexslew_plant.external.messages import Message, MessageKind, PlantFault, text_of


class Transport(Protocol):
    """Carries whole messages, in order. Its errors are a PlantFault of one line."""

    @property
    def name(self) -> str:
        """Name of the other end, for errors."""

    def ask(self, question: bytes, kind: MessageKind, epoch: int, tick: int) -> Message:
        """Send a question; return its answer, which has this kind, epoch and tick."""

    def send(self, message: bytes) -> None:
        """Send a message."""

    def receive(self, timeout: float) -> Message | None:
        """Return the next message; None: none has come within a time [wall s]."""

    @property
    def timeout(self) -> float:
        """Time limit of an answer [wall s]."""

    def set_timeout(self, timeout: float) -> None:
        """Set the time limit of an answer [wall s]."""

    def close(self) -> int | None:
        """End the transport; return the exit status of a process, None if it had to be killed."""


def answer_to(
    transport: Transport, question: bytes, kind: MessageKind, epoch: int, tick: int
) -> Message:
    """Return the answer to a question.

    Args:
        transport: to the other end.
        question: a message.
        kind: of the answer.
        epoch: of the answer.
        tick: of the answer.

    Raises:
        PlantFault: if there is none, it is another one, or the other end reports an error.
    """
    try:
        answer = transport.ask(question, kind, epoch, tick)
    except PlantFault as error:
        place = "" if kind is MessageKind.DESCRIPTION else f" (tick {tick} of epoch {epoch})"
        raise PlantFault(f"{error}{place}") from None
    words = ""
    if answer.kind == MessageKind.ERROR:
        words = f"reports: {text_of(answer.body)}"
    elif answer.kind != kind:
        words = f"sent a message of kind {answer.kind}; {kind} ({kind.name}) is due"
    elif (answer.epoch, answer.tick) != (epoch, tick):
        place = f"tick {answer.tick} of epoch {answer.epoch}"
        words = f"answered {place}; tick {tick} of epoch {epoch} is due"
    if words:
        raise PlantFault(f"{transport.name}: {words}")
    return answer
