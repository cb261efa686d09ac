"""A control law outside of Python, in lock-step: a program, or a board behind a serial line.

A trial names it like a class of the user's own, so a log that names it starts no program and opens
no port untrusted:

    mine: {law: flexslew_control.external_controller.ExternalController, command: [./mine]}
    board: {law: flexslew_control.external_controller.ExternalController, port: /dev/ttyACM0}
"""

from collections.abc import Callable
from time import perf_counter
from typing import NoReturn

import numpy as np

from flexslew_control.law import Estimate, LawFailed, PlantDescription, Reference
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.events import Fact, WallTimes
from flexslew_plant.external.controller_link import ControllerHello, RemoteController
from flexslew_plant.external.messages import PlantFault
from flexslew_plant.external.plant_process import PlantProcess
from flexslew_plant.external.transport import Transport
from flexslew_plant.measurement import Measurement
from flexslew_plant.own_code import require_command
from flexslew_plant.serial_line.exchange import Exchange, Patience
from flexslew_plant.serial_line.port import BAUD, Port, SerialPort
from flexslew_plant.settings import Positive, section
from flexslew_plant.step_times import StepTimes

_FIRST = 64  # answers, after which their times are noted first


def controller_numbers(measurement: Measurement, reference: Reference) -> Vector:
    """Return what a board receives at a tick; see RemoteController.efforts."""
    return np.concatenate(
        (
            measurement.joint_position,
            measurement.joint_velocity,
            measurement.tip_deflection,
            measurement.root_curvature,
            measurement.applied_effort,
            reference.position,
            reference.velocity,
            reference.effort,
        )
    )


def controller_hello(plant: PlantDescription) -> ControllerHello:
    """Return what a board receives first."""
    model = plant.testbed.model()
    limit = tuple(plant.effort_limit.tolist())
    return ControllerHello(plant.period, model.joint_names, model.appendages.names, limit)


@section
class ExternalControllerSettings:
    """The program, or the line to a board.

    Raises:
        BadInput: both or neither are given.
    """

    command: tuple[str, ...] = ()  # program and its arguments; or give `port`
    port: str = ""  # path of the serial port to a board; or give `command`
    baud: Positive = BAUD  # rate of the line [bit/s]
    start_timeout: Positive = 30.0  # longest wait for its description, of wall time [s]
    timeout: Positive = 1.0  # longest wait for an answer, of wall time; then the law has failed [s]
    repeat_after: Positive = 0.05  # wall time after which a question is sent again on a line [s]

    def __post_init__(self) -> None:
        """Check that there is one way to it."""
        if bool(self.command) == bool(self.port):
            raise BadInput("give either a program or a serial port", key="command or port")


class ExternalController:
    """The law of a program or a board; see docs/external_controller.md and docs/rig.md.

    It is started at the first answer: to plan or to read a trial needs none.

    Args:
        settings: of the program or line.
        plant: that it controls.
        open_port: opens a line; tests open another one.

    Attributes:
        remarks: times of its answers after 64, 128, 256, ... steps, for the log.

    Raises:
        Untrusted: if the program may not be started.
    """

    flight_only = True  # a planner must not fly it for its prediction

    Settings = ExternalControllerSettings

    def __init__(
        self,
        settings: ExternalControllerSettings,
        plant: PlantDescription,
        open_port: Callable[[str, int], Port] = SerialPort,
    ) -> None:
        if settings.command:
            require_command(plant.trust, settings.command, "command")
        self._settings, self._hello, self._open = settings, controller_hello(plant), open_port
        self._link: RemoteController | None = None
        self._times = StepTimes()
        self.remarks: tuple[Fact, ...] = ()

    def __deepcopy__(self, memo: object) -> NoReturn:
        """Refuse: a copy would send the program or board questions of its own.

        Raises:
            TypeError: always.
        """
        raise TypeError("an external controller cannot be copied")

    def reset(
        self, measurement: Measurement, estimate: Estimate, reference: Reference, effort: Vector
    ) -> None:
        """Restart its memory where it becomes active.

        Raises:
            LawFailed: it does not answer, or cannot be reached.
        """
        try:
            self._linked().reset(measurement.epoch, measurement.tick, effort)
        except (PlantFault, BadInput) as error:
            raise LawFailed(str(error)) from None

    def update(self, measurement: Measurement, estimate: Estimate, reference: Reference) -> Vector:
        """Return its efforts, shape (efforts,) [N m or N].

        Raises:
            LawFailed: it does not answer within the time limit, or not as it must.
        """
        numbers = controller_numbers(measurement, reference)
        began = perf_counter()
        try:
            efforts = self._linked().efforts(measurement.epoch, measurement.tick, numbers)
        except (PlantFault, BadInput) as error:
            raise LawFailed(str(error)) from None
        self._times.add(perf_counter() - began)
        summary = self._times.summary_of_power(_FIRST)
        self.remarks = () if summary is None else (WallTimes("controller", *summary),)
        return efforts

    def close(self) -> None:
        """End the program or give the port back; the next answer starts it again."""
        if self._link is not None:
            self._link.close()
            self._link = None

    def _linked(self) -> RemoteController:
        """Return the link to the program or board, started."""
        if self._link is None:
            transport = self._transport()
            try:
                self._link = RemoteController(transport, self._hello)
            except PlantFault:
                transport.close()
                raise
            transport.set_timeout(self._settings.timeout)
        return self._link

    def _transport(self) -> Transport:
        """Return what carries messages to the program or board."""
        given = self._settings
        if given.command:
            return PlantProcess(given.command, given.start_timeout)
        port = self._open(given.port, int(given.baud))
        return Exchange(port, Patience(given.start_timeout, given.repeat_after))
