"""A serial port as pyserial opens it: bytes out, and bytes in within a time limit."""

from typing import Protocol

from flexslew_plant.errors import BadInput
from flexslew_plant.extras import required

BAUD = 921_600  # [bit/s]


class Port(Protocol):
    """A line that carries bytes. Its errors are OSError."""

    @property
    def name(self) -> str:
        """Name for errors."""

    def write(self, data: bytes) -> None:
        """Send all bytes, within a time limit."""

    def read(self, timeout: float) -> bytes:
        """Return the bytes that have come, empty if none come within this time [wall s]."""

    def close(self) -> None:
        """Give the port back."""


class SerialPort:
    """A port of this machine.

    Args:
        device: its path, as /dev/ttyACM0.
        baud: rate of the line [bit/s]; USB devices ignore it.
        write_timeout: longest wait until the line takes what is sent [wall s].

    Raises:
        BadInput: if pyserial is not installed, or the port cannot be opened.
    """

    def __init__(self, device: str, baud: int = BAUD, write_timeout: float = 1.0) -> None:
        self.name = device
        try:
            serial = required("serial")
        except ModuleNotFoundError as error:
            raise BadInput(str(error), key="port", value=device) from None
        try:
            # no other program may read half of the answers
            self._serial = serial.Serial(
                device, baud, timeout=0.0, write_timeout=write_timeout, exclusive=True
            )
        except (OSError, ValueError) as error:
            words = f"cannot be opened ({error}); `ls /dev/tty*` lists the ports of this machine"
            raise BadInput(words, key="port", value=device) from None

    def write(self, data: bytes) -> None:
        """Send all bytes.

        Raises:
            OSError: the line does not take them within the time limit, or is gone.
        """
        self._serial.write(data)

    def read(self, timeout: float) -> bytes:
        """Return the bytes that have come, empty if none come within this time [wall s].

        Raises:
            OSError: the port is gone.
        """
        line = self._serial
        line.timeout = timeout
        first: bytes = line.read(1)
        return first + line.read(line.in_waiting) if first else b""

    def close(self) -> None:
        """Give the port back."""
        self._serial.close()
