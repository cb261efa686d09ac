"""Starts the processes of a trial, watches them, ends them; uses no ROS messages."""

import fcntl
import os
import re
import selectors
import signal
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from time import monotonic

from flexslew_lab.run.fork_server import BEFORE_FORK, ForkServer
from flexslew_lab.run.outcome import Outcome as Outcome
from flexslew_lab.run.processes import NodeProcess
from flexslew_lab.run.standstill import StallMonitor

_TICK = re.compile(rb"^tick (\d+) of (\d+)$")
_LEAVES = re.compile(rb"^leaves with exit code (\d+)$")
_PIPE_SIZE = 1 << 20  # unread output of a node; Linux gives 64 KiB [bytes]
_GRACE = 10.0  # from one signal to the next stronger one [wall s]
_EXIT_TIMEOUT = 90.0  # for nodes that leave after the plant [wall s]; see ros_node.CLOSE_TIMEOUT
_CHECK_PERIOD = 5.0  # at whether the processes stand still, every so often [wall s]
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)
_FORCED_CODES = (-signal.SIGALRM, -signal.SIGKILL)  # ended while it left: its own code counts
# signals that end a crashed process
_ERROR_SIGNALS = (signal.SIGSEGV, signal.SIGABRT, signal.SIGBUS, signal.SIGFPE, signal.SIGILL)


class Supervisor:
    """The processes of one run.

    A controller or planner that crashes before the start, or stands still in DDS at any time, is
    started again, once. Plant and recorder are not: other nodes depend on the plant, and the
    recorder has started its bag. A process that stands still is killed.

    Args:
        processes: processes to start; the end of the last one, the plant, is the end of the run.
        parameters: the ROS parameter file.
        log: file for the output of the processes.
        domain: ROS_DOMAIN_ID for all of them.
        progress: called with the tick and the last tick.
        server: fork server that starts them; None: a new one.
    """

    def __init__(
        self,
        processes: list[NodeProcess],
        parameters: Path,
        log: Path,
        domain: int,
        progress: Callable[[int, int], None],
        server: ForkServer | None = None,
    ) -> None:
        self._progress = progress
        self._local_server = server is None
        self._server = server or ForkServer([BEFORE_FORK, *(p.module for p in processes)])
        self._plant = processes[-1].name
        self._restarts = {p.name: p for p in processes if p.package == "flexslew_control"}
        self._tick = -1
        self._left: float | None = None  # when the first one ended before the start [wall s]
        self._error_message = ""
        self._log = log.open("wb")
        self._running: dict[str, int] = {}  # pids
        self._codes: dict[str, int] = {}
        self._final_codes: dict[str, int] = {}  # exit codes, reported by leaving nodes
        self._selector = selectors.DefaultSelector()
        self._rest: dict[str, bytes] = {}
        self._stall_monitor, self._next_check = StallMonitor(), monotonic() + _CHECK_PERIOD
        self._stuck: set[str] = set()  # killed for it
        self._stopped: set[str] = set()  # nodes that had to be ended after the plant
        self._parameters = parameters
        self._environment = os.environ | {"ROS_DOMAIN_ID": str(domain)}
        self._environment.setdefault("ROS_LOG_DIR", str(log.parent.resolve() / "ros_log"))
        for process in processes:
            self._start(process)

    @property
    def pids(self) -> dict[str, int]:
        """Process ids by node name, of those that still run."""
        return dict(self._running)

    def run(self) -> Outcome:
        """Wait for the plant to end, then for the others; Ctrl-C ends all of them."""
        try:
            while self._plant in self._running:
                self._poll(0.2)
                self._kill_the_stuck()
                lost = self._lost()
                if lost:
                    self._end()
                    code = 2 if self._codes[lost] == 2 else 3
                    return self._outcome(code, f"{lost} ended before the start")
            self._wait_for_rest()
        except KeyboardInterrupt:
            self._end()
            return self._outcome(130, "interrupted")
        except BaseException:
            self._end()
            raise
        return self._final_outcome()

    def _lost(self) -> str:
        """Return a node that ended before the start, which would then never come; empty: none.

        A node with exit code 0 counts after a delay: nodes leave together with the plant, which may
        need a moment longer.
        """
        if self._tick >= 0:
            return ""
        finished = [name for name in self._codes if name != self._plant]
        if finished and self._left is None:
            self._left = monotonic()
        late = self._left is not None and monotonic() - self._left > _GRACE
        return next((name for name in finished if self._codes[name] or late), "")

    def _start(self, process: NodeProcess) -> None:
        arguments = ["--ros-args", "--params-file", str(self._parameters)]
        if process.name:  # empty: several nodes, each with the name that it gives itself
            arguments += ["-r", f"__node:={process.name}"]
        if process.namespace:
            arguments += ["-r", f"__ns:={process.namespace}"]
        for old, new in process.remappings:
            arguments += ["-r", f"{old}:={new}"]
        read_end, write_end = os.pipe()
        with suppress(OSError):  # a terminal that rests for a while does not hold up the nodes
            fcntl.fcntl(read_end, fcntl.F_SETPIPE_SZ, _PIPE_SIZE)
        try:
            pid = self._server.start(process.module, arguments, self._environment, write_end)
        finally:
            os.close(write_end)
        os.set_blocking(read_end, False)
        self._selector.register(read_end, selectors.EVENT_READ, process.name)
        self._running[process.name] = pid
        self._rest[process.name] = b""

    def _poll(self, timeout: float) -> None:
        """Take the output of the processes and note those that have ended."""
        for key, _ in self._selector.select(timeout):
            data = os.read(key.fd, 65536)
            self._take(key.data, data)
            if not data:
                self._selector.unregister(key.fileobj)
                os.close(key.fd)
        for name, pid in list(self._running.items()):
            code = self._server.exit_code(pid)
            if code is None:
                continue
            del self._running[name]
            is_error = self._tick < 0 and -code in _ERROR_SIGNALS
            if (is_error or name in self._stuck) and name in self._restarts:
                why = f"crashed ({signal.Signals(-code).name}) before the start"
                self._note(name, f"{why if is_error else 'killed'}: started again")
                self._stuck.discard(name)
                self._start(self._restarts.pop(name))
            else:
                self._codes[name] = (
                    self._final_codes.get(name, code) if code in _FORCED_CODES else code
                )

    def _kill_the_stuck(self) -> None:
        if monotonic() < self._next_check:
            return
        self._next_check = monotonic() + _CHECK_PERIOD
        for name, pid in self._running.items():
            if name not in self._stuck and self._stall_monitor.of(pid):
                self._note(name, "stands still in DDS: its timers have not run for a while")
                self._stuck.add(name)
                os.kill(pid, signal.SIGKILL)

    def _note(self, name: str, words: str) -> None:
        """Write into the log a message of the supervisor itself about a process."""
        self._take(name, b"\n" * bool(self._rest[name]) + words.encode() + b"\n")

    def _take(self, name: str, data: bytes) -> None:
        *lines, self._rest[name] = (self._rest[name] + data).split(b"\n")
        for line in lines:
            found = _TICK.match(line)
            if found:
                self._tick = int(found[1])
                self._progress(self._tick, int(found[2]))
                continue
            leaves = _LEAVES.match(line)
            if leaves:
                self._final_codes[name] = int(leaves[1])
                continue
            if line.startswith(b"error: "):
                self._error_message = line[7:].decode(errors="replace")
            self._log.write(f"[{name}] ".encode() + line + b"\n")
            self._log.flush()

    def _wait_for_rest(self) -> None:
        """Wait for the others, which leave once the plant is gone and their last messages are read.

        A stopped process continues, to leave as the others do. One that DDS holds up is ended: the
        run is over, so that this affects the result only for the recorder.
        """
        self._restarts.clear()
        for name in self._running:
            self._signal(name, signal.SIGCONT)
        left, end = {*self._running} - self._stuck, monotonic() + _EXIT_TIMEOUT
        while self._running and monotonic() < end:
            self._poll(0.05)
            self._kill_the_stuck()
        self._stopped = (left & self._stuck | {*self._running}) - {"recorder"}
        for name in self._running:
            self._note(name, "does not leave: ended")
        self._end()

    def _end(self) -> None:
        """End what still runs: the plant first, so that the recorder gets its last messages."""
        self._restarts.clear()
        order = sorted(self._running, key=lambda name: (name == "recorder", name != self._plant))
        for name in order:
            for signal_number in _SIGNALS:
                if name not in self._running:
                    break
                self._signal(name, signal_number)
                self._signal(name, signal.SIGCONT)  # one that is stopped takes no other signal
                end = monotonic() + _GRACE
                while name in self._running and monotonic() < end:
                    self._poll(0.05)
        self._poll(0.0)

    def _signal(self, name: str, number: int) -> None:
        with suppress(ProcessLookupError):  # it has just ended
            os.kill(self._running[name], number)

    def _final_outcome(self) -> Outcome:
        if self._codes[self._plant] not in (0, 3):
            return self._outcome(3, "the plant ended by itself")
        for name, code in self._codes.items():
            if name != self._plant and code and name not in self._stopped:
                return self._outcome(3, f"{name} ended during the run")
        if self._codes[self._plant]:
            if self._error_message:
                return self._outcome(3, "the run ended early")
            return self._outcome(3, "a controller fell silent; see the events")
        return self._outcome(0, "")

    def _outcome(self, code: int, message: str) -> Outcome:
        for key in list(self._selector.get_map().values()):  # a grandchild still holds it
            os.close(key.fd)
        self._selector.close()
        self._log.close()
        if self._local_server:
            self._server.close()
        error = self._error_message
        finished = ", ".join(f"{n}: {c}" for n, c in self._codes.items() if c not in (0, 130, -2))
        details = error or (f"exit codes {finished}" if finished and code == 3 else "")
        return Outcome(code, f"{message} ({details})" if details else message)
