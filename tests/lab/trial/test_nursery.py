"""Processes that are copies of one, and what becomes of them."""

import os
import select
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from flexslew_lab.trial.nursery import Nursery
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
def nursery(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Nursery]:
    (tmp_path / "grown.py").write_text(CHILD)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{os.environ['PYTHONPATH']}")
    one = Nursery(["grown", "nowhere_to_be_found"])
    yield one
    one.close()


def born(nursery: Nursery, *words: str, module: str = "grown") -> tuple[int, int]:
    """Return the pid of a new process and what it says."""
    said, says = os.pipe()
    try:
        return nursery.start(module, list(words), {"COLOUR": "red"}, says), said
    finally:
        os.close(says)


def ended(nursery: Nursery, pid: int) -> int:
    for _ in range(600):
        code = nursery.exit_code(pid)
        if code is not None:
            return code
        select.select([], [], [], 0.05)
    raise AssertionError("it never ended")


def everything(said: int) -> str:
    with open(said) as file:  # until the last one has closed the other end
        return file.read()


def test_each_has_its_own_words_environment_session_and_exit_code(nursery: Nursery) -> None:
    first, second = born(nursery, "5"), born(nursery, "0")
    assert first[0] != second[0]
    for (pid, said), code in ((first, 5), (second, 0)):
        arguments, error = everything(said).splitlines()
        assert arguments.startswith(f"['grown', '{code}'] red True ")
        assert arguments.endswith(f" {nursery._process.pid}")
        assert error == "error: said so"
        assert ended(nursery, pid) == code
    assert "COLOUR" not in os.environ


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_one_can_be_ended_alone(nursery: Nursery, number: signal.Signals) -> None:
    (pid, said), (other, _) = born(nursery, "wait"), born(nursery, "wait")
    os.read(said, 1)  # it has begun
    os.kill(pid, number)
    assert ended(nursery, pid) == -number
    assert nursery.exit_code(other) is None
    os.kill(other, signal.SIGKILL)
    assert ended(nursery, other) == -signal.SIGKILL


def test_a_module_that_is_not_there_is_the_fault_of_its_process_alone(nursery: Nursery) -> None:
    pid, said = born(nursery, module="nowhere_to_be_found")
    assert "No module named 'nowhere_to_be_found'" in everything(said)
    assert ended(nursery, pid) == 1
    assert ended(nursery, born(nursery, "0")[0]) == 0


def test_when_it_is_killed_nobody_is_waited_for(nursery: Nursery) -> None:
    pid, _ = born(nursery, "wait")
    os.kill(nursery._process.pid, signal.SIGKILL)
    assert ended(nursery, pid) == 1
    os.kill(pid, signal.SIGKILL)
    with pytest.raises(FlexslewError, match="is gone"):
        born(nursery, "0")
