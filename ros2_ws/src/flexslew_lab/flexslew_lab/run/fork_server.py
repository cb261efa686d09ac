"""Nodes as copies of one process that has imported what they need: six start as fast as one.

What costs a node its start is imports, about 1.5 s of processor time. The fork server, a process of
its own, makes them once, calls `before_fork` of each module that has it, and then forks; it has
neither threads nor a place on any graph. Each node is a process like any other one: its own pid,
session and exit code, and it can be killed alone.
"""

import gc
import importlib
import json
import os
import selectors
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from threading import Lock

from flexslew_lab.run.shared_memory import require_shared_memory
from flexslew_plant.errors import FlexslewError

BEFORE_FORK = "flexslew_lab.ros.before_fork"  # does what all nodes have in common
_LARGEST = 1 << 17  # of a request or a report [B]
_LOST = 1  # exit code of a node after its fork server was killed: it ends by itself


class ForkServer:
    """Starts nodes and receives their exit codes.

    Args:
        modules: modules that nodes will run, and BEFORE_FORK; others are imported at their start.

    Raises:
        BadInput: if they could not start on this machine.
    """

    def __init__(self, modules: Iterable[str]) -> None:
        require_shared_memory()
        self._pipe, child_socket = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with child_socket:
            command = [
                sys.executable,
                "-P",
                "-m",
                __name__,
                str(child_socket.fileno()),
                *sorted({*modules}),
            ]
            self._process = subprocess.Popen(  # a session of its own: Ctrl-C is not for it
                command,
                stdin=subprocess.DEVNULL,
                pass_fds=(child_socket.fileno(),),
                env=os.environ
                | {
                    "PYTHONUNBUFFERED": "1",
                    "OMP_NUM_THREADS": "1",  # tiny matrices: more threads only take turns
                    "OPENBLAS_NUM_THREADS": "1",
                },
                start_new_session=True,
            )
        self._lock = Lock()  # several may start at once
        self._running: set[int] = set()
        self._exit_codes: dict[int, int] = {}

    def start(
        self, module: str, arguments: list[str], environment: Mapping[str, str], output: int
    ) -> int:
        """Return the pid of a new process that runs `main` of a module.

        Args:
            module: dotted name.
            arguments: arguments of the command line.
            environment: variables added to those of this process.
            output: open file for its standard output and error.

        Raises:
            FlexslewError: if the fork server is gone.
        """
        request = {"module": module, "arguments": arguments, "environment": dict(environment)}
        with self._lock:
            with suppress(OSError):
                socket.send_fds(self._pipe, [json.dumps(request).encode()], [output])
            while True:
                report = self._next()
                if report is None:
                    raise FlexslewError("the process that starts the nodes is gone")
                if "born" in report:
                    self._running.add(report["born"])
                    return report["born"]

    def exit_code(self, pid: int) -> int | None:
        """Return how a process has ended, a signal as a negative number; None: it runs."""
        with self._lock:
            with suppress(BlockingIOError):
                self._pipe.setblocking(False)
                while self._running and self._next() is not None:
                    pass
            self._pipe.setblocking(True)
            return self._exit_codes.get(pid)

    def close(self) -> None:
        """End it; nodes that still run end by themselves."""
        self._pipe.close()
        self._process.wait()

    def _next(self) -> dict[str, int] | None:
        """Take a report; None: there will be no more."""
        data = b""
        with suppress(ConnectionResetError):  # it was killed with a request unread
            data = self._pipe.recv(_LARGEST)
        if not data:
            self._exit_codes |= dict.fromkeys(self._running, _LOST)
            self._running.clear()
            return None
        report: dict[str, int] = json.loads(data)
        if "dead" in report:
            self._running.discard(report["dead"])
            self._exit_codes[report["dead"]] = report["code"]
        return report


def _run_server(pipe: socket.socket) -> Callable[[], None] | None:
    """Fork on request; return what the forked process is to run, or None at the end."""
    selector = selectors.DefaultSelector()
    selector.register(pipe, selectors.EVENT_READ)
    while True:
        for key, _ in selector.select():
            if key.data is not None:  # a child: its handle is readable when it has ended
                selector.unregister(key.fileobj)
                os.close(key.fd)
                code = os.waitstatus_to_exitcode(os.waitpid(key.data, 0)[1])
                _report(pipe, {"dead": key.data, "code": code})
                continue
            data, handles, _, _ = socket.recv_fds(pipe, _LARGEST, 1)
            if not data:
                return None
            supervisor = os.getpid()
            pid = os.fork()
            if pid == 0:
                for other in list(selector.get_map().values()):
                    os.close(other.fd)
                selector.close()
                pipe.detach()
                return _start_child(json.loads(data), handles[0], supervisor)
            os.close(handles[0])
            selector.register(os.pidfd_open(pid), selectors.EVENT_READ, pid)
            _report(pipe, {"born": pid})


def _report(pipe: socket.socket, words: dict[str, int]) -> None:
    with suppress(OSError):  # no reader is left
        pipe.send(json.dumps(words).encode())


def _start_child(request: dict[str, object], output: int, supervisor: int) -> Callable[[], None]:
    """Become a process of one's own; return what it is to run."""
    os.setsid()
    os.dup2(output, 1)
    os.dup2(output, 2)
    os.close(output)
    os.environ.update(request["environment"])  # type: ignore[call-overload]
    os.environ["FLEXSLEW_SUPERVISOR"] = str(supervisor)  # it ends when that one is gone
    signal.signal(signal.SIGINT, signal.default_int_handler)
    module, arguments = str(request["module"]), request["arguments"]
    sys.argv = [module, *arguments]  # type: ignore[misc]
    with suppress(OSError):  # what ps and top show
        Path("/proc/self/comm").write_text(module.rpartition(".")[2].removesuffix("_node")[:15])
    return lambda: importlib.import_module(module).main()


def main() -> None:
    """Serve the fork server with the socket and modules that the command line names."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    pipe = socket.socket(fileno=int(sys.argv[1]))
    for name in sys.argv[2:]:
        with suppress(ImportError):  # the node itself will report it
            getattr(importlib.import_module(name), "before_fork", lambda: None)()
    gc.collect()
    gc.freeze()  # else each copy would soon have its own pages
    run = _run_server(pipe)
    if run is not None:
        run()


if __name__ == "__main__":
    main()
