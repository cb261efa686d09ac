"""A controller of any language in a process of its own, in a ROS domain of its own."""

import os
import shlex
import signal
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from flexslew_lab.run.domain import locked_domain
from flexslew_plant.errors import BadInput

_STDERR = 2  # where its standard output goes: that of this process may be JSON
_DOMAIN = "ROS_DOMAIN_ID"
# until a controller that received SIGTERM is killed [wall s]; a node may need 10 s to leave the
# graph of Fast DDS (docs/limits.md), and more if other processes use the processors
_EXIT_TIMEOUT = 30.0


class ControllerProcess:
    """The process of a controller.

    Args:
        command: program and arguments.

    Raises:
        BadInput: if there is no such program.
    """

    def __init__(self, command: Sequence[str]) -> None:
        self.command = list(command)
        self._process = self._start()

    @property
    def name(self) -> str:
        """The command as a shell reads it."""
        return shlex.join(self.command)

    def exit_words(self) -> str:
        """Return how the process has ended; empty: it runs."""
        code = self._process.poll()
        if code is None:
            return ""
        how = f"exit code {code}" if code >= 0 else f"signal {-code}"
        return f"its process has ended ({how})"

    def stop(self, stopped: bool) -> None:
        """Stop the process (True), or let it go on."""
        self._signal(signal.SIGSTOP if stopped else signal.SIGCONT)

    def restart(self) -> str:
        """End the process and start another one; return what end returns."""
        wrong = self.end()
        self._process = self._start()
        return wrong

    def end(self, timeout: float = _EXIT_TIMEOUT) -> str:
        """End the process; return what is wrong if SIGTERM does not end it, else "".

        Args:
            timeout: until it is killed [wall s].
        """
        self._signal(signal.SIGTERM)
        try:
            self._process.wait(timeout)
            return ""
        except subprocess.TimeoutExpired:
            self._signal(signal.SIGKILL)
            self._process.wait()
            return f"SIGTERM has not ended its process within {timeout:g} s; it was killed"

    def _signal(self, number: signal.Signals) -> None:
        """Send a signal to the process and its children, such as those of a shell script."""
        if self._process.poll() is None:
            os.killpg(self._process.pid, number)

    def _start(self) -> "subprocess.Popen[bytes]":
        try:
            return subprocess.Popen(self.command, stdout=_STDERR, start_new_session=True)
        except (OSError, ValueError) as error:
            why = error.strerror if isinstance(error, OSError) else str(error)
            raise BadInput(f"COMMAND: {self.command[0]}: {why}") from None


@contextmanager
def controller_process(command: Sequence[str], what: str) -> Iterator[ControllerProcess]:
    """Start a controller in a ROS domain that no other run uses; end it after the block.

    Args:
        command: program and arguments.
        what: description of the run, for commands that look for a bench.

    Raises:
        BadInput: if there is no such program.
        FlexslewError: if no domain is free.
    """
    before = os.environ.get(_DOMAIN)
    with locked_domain(what, bench=False) as domain:
        os.environ[_DOMAIN] = str(domain)
        try:
            process = ControllerProcess(command)
            try:
                yield process
            finally:
                process.end()
        finally:
            if before is None:
                del os.environ[_DOMAIN]
            else:
                os.environ[_DOMAIN] = before
