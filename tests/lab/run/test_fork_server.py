"""Processes that are copies of one, and what becomes of them."""

import os
import select
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from flexslew_lab.run.fork_server import ForkServer
from flexslew_plant.errors import FlexslewError

CHILD = """
import os, signal, sys

def main():
    print(sys.argv, os.environ["COLOUR"], os.getsid(0) == os.getpid(), os.getppid(), flush=True)
    print("error: said so", file=sys.stderr, flush=True)
    if sys.argv[1] == "wait":
        signal.pause()
    sys.exit(int(sys.argv[1]))
"""


@pytest.fixture
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ForkServer]:
    (tmp_path / "grown.py").write_text(CHILD)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{os.environ['PYTHONPATH']}")
    one = ForkServer(["grown", "nowhere_to_be_found"])
    yield one
    one.close()


def born(server: ForkServer, *words: str, module: str = "grown") -> tuple[int, int]:
    """Return the pid of a new process and what it says."""
    said, says = os.pipe()
    try:
        return server.start(module, list(words), {"COLOUR": "red"}, says), said
    finally:
        os.close(says)


def ended(server: ForkServer, pid: int) -> int:
    for _ in range(600):
        code = server.exit_code(pid)
        if code is not None:
            return code
        select.select([], [], [], 0.05)
    raise AssertionError("it never ended")


def everything(said: int) -> str:
    with open(said) as file:  # until the last one has closed the other end
        return file.read()


def test_each_has_its_own_words_environment_session_and_exit_code(server: ForkServer) -> None:
    first, second = born(server, "5"), born(server, "0")
    assert first[0] != second[0]
    for (pid, said), code in ((first, 5), (second, 0)):
        arguments, error = everything(said).splitlines()
        assert arguments.startswith(f"['grown', '{code}'] red True ")
        assert arguments.endswith(f" {server._process.pid}")
        assert error == "error: said so"
        assert ended(server, pid) == code
    assert "COLOUR" not in os.environ


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_one_can_be_ended_alone(server: ForkServer, number: signal.Signals) -> None:
    (pid, said), (other, _) = born(server, "wait"), born(server, "wait")
    os.read(said, 1)  # it has begun
    os.kill(pid, number)
    assert ended(server, pid) == -number
    assert server.exit_code(other) is None
    os.kill(other, signal.SIGKILL)
    assert ended(server, other) == -signal.SIGKILL


def test_a_module_that_is_not_there_is_the_fault_of_its_process_alone(server: ForkServer) -> None:
    pid, said = born(server, module="nowhere_to_be_found")
    assert "No module named 'nowhere_to_be_found'" in everything(said)
    assert ended(server, pid) == 1
    assert ended(server, born(server, "0")[0]) == 0


def test_when_it_is_killed_nobody_is_waited_for(server: ForkServer) -> None:
    pid, _ = born(server, "wait")
    os.kill(server._process.pid, signal.SIGKILL)
    assert ended(server, pid) == 1
    os.kill(pid, signal.SIGKILL)
    with pytest.raises(FlexslewError, match="is gone"):
        born(server, "0")


def test_what_a_module_does_before_a_fork_is_done_once_for_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    once = "import os\nseen = []\n\ndef before_fork(): seen.append(os.getpid())\n"
    (tmp_path / "settled.py").write_text(f"{once}\ndef main(): print(seen)\n")
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{os.environ['PYTHONPATH']}")
    server = ForkServer(["settled"])
    try:
        for _ in range(2):
            pid, said = born(server, module="settled")
            assert everything(said) == f"[{server._process.pid}]\n"
            assert ended(server, pid) == 0
    finally:
        server.close()
