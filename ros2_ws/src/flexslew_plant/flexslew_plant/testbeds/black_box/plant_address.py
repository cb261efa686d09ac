"""Where an external plant is reached: a program to start, or a serial port."""

import shlex
from typing import NamedTuple

from flexslew_plant.errors import BadInput
from flexslew_plant.external.messages import PlantFault
from flexslew_plant.external.plant_link import Hello, PlantLink
from flexslew_plant.external.plant_process import PlantProcess
from flexslew_plant.external.transport import Transport
from flexslew_plant.serial_line.exchange import Exchange, Patience
from flexslew_plant.serial_line.port import BAUD, SerialPort


class PlantAddress(NamedTuple):
    """A command, or a serial port where one is given."""

    command: tuple[str, ...] = ()  # program and its arguments
    serial: str = ""  # path of the port
    baud: int = BAUD  # rate of the line [bit/s]
    timeout: float = 10.0  # longest wait for an answer [wall s]

    @property
    def name(self) -> str:
        """Name for --trust, as in a shell."""
        return shlex.join((self.serial,) if self.serial else self.command)

    def connect(self) -> Transport:
        """Return the transport to the plant.

        Raises:
            PlantFault: the program cannot be started.
            BadInput: the port cannot be opened.
        """
        if not self.serial:
            return PlantProcess(self.command, self.timeout)
        return Exchange(SerialPort(self.serial, self.baud), Patience(self.timeout))

    def link(self, hello: Hello, source: str = "") -> PlantLink:
        """Return the plant after it has described itself.

        Raises:
            BadInput: it cannot be reached, or breaks the protocol.
        """
        key, value = ("serial", self.serial) if self.serial else ("command", list(self.command))
        try:
            return PlantLink(self.connect(), hello)
        except PlantFault as error:
            raise BadInput(str(error), source, key, value) from None
        except BadInput as error:
            raise BadInput(error.refusal.why, source, key, value) from None
