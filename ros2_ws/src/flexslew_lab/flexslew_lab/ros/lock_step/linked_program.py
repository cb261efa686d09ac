"""Any controller's process in lock-step, for the replay of a log."""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from time import monotonic
from typing import Any

from flexslew_lab.log.messages.cdr import decode
from flexslew_lab.ros.lock_step.controller_connection import ControllerConnection, ControllerFault
from flexslew_lab.run.controller_process import ControllerProcess, controller_process
from flexslew_plant.bench.operation.run_state import RUNNING
from flexslew_plant.graph import topics
from flexslew_plant.measurement import EffortCommand, Measurement
from flexslew_plant.ros.offers import publisher

_SETTLE = 0.3  # after which the graph is complete in both directions [wall s]
_NOT_READY = 0.02  # in which a controller that is not ready may become so [wall s]
_LEAD = 900  # questions to others that it may be behind, see docs/any_language.md
_FAULT_EXIT = 3.0  # until a process at fault is killed [wall s]
_PLAN_PATIENCE = 2.0  # until a program that reports no plan is taken to follow it [wall s]


class LinkedProgram:
    """A controller's process that answers the questions of a log; see replay.program.

    Args:
        link: to the process.
        process: of the controller.

    Attributes:
        command: as a shell reads it.
    """

    def __init__(self, link: ControllerConnection, process: ControllerProcess) -> None:
        self._link, self._process = link, process
        self._plan = publisher(link.node, topics.PLAN)
        self._epoch = -1
        self._unseen: deque[tuple[int, int]] = deque()  # epoch and tick of questions to others
        self.command = process.name

    @property
    def name(self) -> str:
        """Name of the controller, as it calls itself."""
        return self._link.name

    @property
    def reason(self) -> str:
        """Why it is not ready, as it reports; empty: it is."""
        status = self._link.status
        return "" if status is None or status.ready else f"not ready: {status.reason}"

    def start(self, plans: Sequence[bytes]) -> None:
        """Announce the testbed and publish the plans; return when it can answer.

        Raises:
            ControllerFault: it does not become ready.
        """
        link = self._link
        link.wait_for_start()
        for plan in plans:
            self._plan.publish(plan)
        link.announce()
        link.until(
            lambda: link.node.count_publishers(topics.EFFORT_COMMAND) > 0,
            "nothing publishes effort_command",
        )
        link.spin(_SETTLE)
        if plans:
            self._wait_for_plan(plans[-1])

    def publish_plan(self, data: bytes) -> None:
        """Publish flexslew_msgs/Plan, as CDR, and wait until the program follows it."""
        self._plan.publish(data)
        self._wait_for_plan(data)

    def observe(self, question: Measurement) -> EffortCommand | None:
        """Return the answer to a question that names the program, None to others or if not ready.

        Raises:
            ControllerFault: the program has ended, gives no answer, or one that a bench rejects.
        """
        try:
            return self._observe(question)
        except ControllerFault as error:
            if not (ended := self._process.exit_words()):
                raise
            raise ControllerFault(f"{ended} at tick {question.tick}") from error

    def _observe(self, question: Measurement) -> EffortCommand | None:
        link = self._link
        if question.epoch > self._epoch:
            self._epoch = question.epoch
            link.publish_state(RUNNING, 0, question.epoch)
        link.commands.clear()
        link.send(question)
        if question.controller != link.name:
            self._unseen.append((question.epoch, question.tick))
            self._wait_for_progress()
            return None
        link.until(
            lambda: bool(link.commands) or not link.ready, f"no answer to tick {question.tick}"
        )
        if not link.commands:
            link.spin(_NOT_READY)
        if not link.commands:
            return None
        self._unseen.clear()
        return link.take_answer(question)

    def _wait_for_progress(self) -> None:
        """Wait while the program is too far behind."""
        if len(self._unseen) <= _LEAD:
            return

        def is_near() -> bool:
            status = self._link.status
            while status and self._unseen and self._unseen[0] <= (status.epoch, status.last_tick):
                self._unseen.popleft()
            return len(self._unseen) <= _LEAD

        self._link.until(is_near, f"no controller_status with one of the last {_LEAD} ticks")

    def _wait_for_plan(self, data: bytes) -> None:
        """Wait until the program reports the plan, if it subscribes to plans."""
        link, digest = self._link, decode("flexslew_msgs/msg/Plan", data).hash
        if not self._plan.get_subscription_count():
            return
        end = monotonic() + _PLAN_PATIENCE
        while monotonic() < end and not (link.status and link.status.plan_hash == digest):
            link.spin_once(0.01)


@contextmanager
def linked_program(
    command: Sequence[str], patience: float, testbed: Mapping[str, Any], plans: Sequence[bytes]
) -> Iterator[LinkedProgram]:
    """Start a controller's process; end it after the block.

    Args:
        command: program and arguments.
        patience: longest wait for anything that must come [wall s].
        testbed: fields of flexslew_msgs/Testbed but for its stamp.
        plans: flexslew_msgs/Plan as CDR, of tick 0.

    Raises:
        BadInput: if there is no such program.
        ControllerFault: in the block, too: if it breaks a rule; the message names the command.
    """
    with controller_process(command, "replay") as process:
        link = ControllerConnection(testbed, patience, process.exit_words)
        try:
            program = LinkedProgram(link, process)
            program.start(plans)
            yield program
        except ControllerFault as error:
            process.end(_FAULT_EXIT)
            raise ControllerFault(f"{process.name}: {error}") from None
        finally:
            process.end()  # a node that ends waits until its messages were received
            link.close()
