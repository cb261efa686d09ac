"""A program of its own in place of a controller of a log: its process, its plans, its answers."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from typing import Any, Protocol

from flexslew_control.controllers.controller import Answer, bare_answer
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.messages.cdr import decode, encode
from flexslew_lab.replay.logged_controllers import Key, is_program, logged_laws
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import EffortCommand, Measurement

_START = (0, 0)  # epoch and tick
_OTHER = "another_controller"  # name of one that has the program's in the log
_TESTBED = (
    *("kind", "joint_names", "joint_units", "appendage_names", "modes", "period"),
    *("effort_limit", "settings"),
)


class ControllerProgram(Protocol):
    """A controller's process that is ready; ros.linked_program starts one."""

    @property
    def command(self) -> str:
        """The command, as a shell reads it."""

    @property
    def name(self) -> str:
        """Name of the controller, as it calls itself."""

    @property
    def reason(self) -> str:
        """Why it is not ready, as it reports; empty: it is."""

    def publish_plan(self, data: bytes) -> None:
        """Publish flexslew_msgs/Plan, as CDR, and wait until the program follows it."""

    def observe(self, question: Measurement) -> EffortCommand | None:
        """Return the answer to a question that names the program; None to others, or if not ready.

        Raises:
            FlexslewError: the program has ended, gives no answer, or one that a bench rejects.
        """


# fields of the testbed, and the plans of tick 0 as CDR, of a program to be started
StartProgram = Callable[
    [Mapping[str, Any], Sequence[bytes]], AbstractContextManager[ControllerProgram]
]


def replaced_controller(bag: BagReader, requested: str = "") -> str:
    """Return the controller of a log that a program stands in for.

    Args:
        bag: to read.
        requested: its name; empty: the only one that was a program of its own, else the first
            active one.

    Raises:
        BadInput: if the log has no such controller, or none was active.
    """
    programs = [name for name, (law, _) in logged_laws(bag).items() if is_program(law)]
    default = programs[0] if len(programs) == 1 else ""
    return compared_controller(bag, requested or default)


def compared_controller(bag: BagReader, requested: str = "") -> str:
    """Return the controller of a log with this name; empty: the first active one.

    Raises:
        BadInput: if the log has no such controller, or none was active.
    """
    if requested:
        laws = logged_laws(bag)
        if requested not in laws:
            raise BadInput(f"no controller {requested}; it has {', '.join(laws)}", bag.path)
        return requested
    for _, _, message in bag.decode_messages(("/measurement",)):
        if message.controller:
            return str(message.controller)
    raise BadInput("no controller was active", bag.path)


def logged_plans(bag: BagReader) -> list[tuple[Key, bytes]]:
    """Return the plans of a log as CDR, each with the first question after it."""
    found, waiting = list[tuple[Key, bytes]](), list[bytes]()
    if not bag.overview.plans:
        return found
    for topic, kind, _, _, data in bag.messages(("/measurement", "/plan")):
        if topic == "/plan":  # of an older log, too
            waiting.append(encode("flexslew_msgs/msg/Plan", decode(kind, data)))
        elif waiting:
            question = decode(kind, data)
            key = int(question.epoch), int(question.tick)
            found += [(key, plan) for plan in waiting]
            waiting.clear()
    return found


def testbed_of(bag: BagReader) -> dict[str, Any]:
    """Return the fields of flexslew_msgs/Testbed of a log but for its stamp.

    Raises:
        BadInput: if the log has none.
    """
    testbed = bag.overview.testbed
    if testbed is None:
        raise BadInput("does not name its testbed (no /testbed)", bag.path)
    return {name: getattr(testbed, name) for name in _TESTBED}


class ProgramController:
    """A program behind the question of a bench, under the name of the controller that it replaces.

    It receives every measurement, and each plan before the first question that followed the plan.

    Args:
        name: of the replaced controller.
        program: that answers.
        plans: to be published, each with the first question after it.
    """

    def __init__(
        self, name: str, program: ControllerProgram, plans: Sequence[tuple[Key, bytes]]
    ) -> None:
        self._name, self._program = name, program
        self._plans = list(plans)
        self._last: tuple[Key, str] | None = None  # question, controller that it names
        self._answer: Answer | None = None
        self._silence: tuple[Key, str] | None = None  # first question without an answer, and why

    def reason(self, key: Key) -> str:
        """Return why the first unanswered question has no answer; empty for all others."""
        return self._silence[1] if self._silence is not None and self._silence[0] == key else ""

    @property
    def command(self) -> str:
        """The program's command, as a shell reads it."""
        return self._program.command

    def observe(self, measurement: Measurement) -> Answer | None:
        """Return the answer if the measurement names this controller; once per question."""
        key = measurement.epoch, measurement.tick
        question = key, measurement.controller
        if question == self._last:  # repeated in the log; a program need not answer again
            return self._answer
        while self._plans and self._plans[0][0] <= key:
            self._program.publish_plan(self._plans.pop(0)[1])
        named = measurement.controller
        if named == self._name:
            named = self._program.name
        elif named == self._program.name:
            named = _OTHER
        command = self._program.observe(measurement._replace(controller=named))
        self._last, self._answer = question, None
        if command is None:
            if named == self._program.name and self._silence is None:
                self._silence = key, f"no answer: {self._program.reason}"
        else:
            self._answer = bare_answer(command._replace(controller=self._name, instance=0))
        return self._answer


@contextmanager
def program_controller(
    bag: BagReader, name: str, start: StartProgram, testbed: Mapping[str, Any]
) -> Iterator[ProgramController]:
    """Start a program in place of a controller of a log; end it after the block.

    Args:
        bag: source of the plans.
        name: of the controller.
        start: starts the program.
        testbed: fields of flexslew_msgs/Testbed but for its stamp.
    """
    plans = logged_plans(bag)
    with start(testbed, [plan for key, plan in plans if key <= _START]) as program:
        yield ProgramController(name, program, [plan for plan in plans if plan[0] > _START])
