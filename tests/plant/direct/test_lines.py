"""Both ends of a line in one process: what is sent arrives, whole and in order, or is refused."""

import os
import socket
from collections.abc import Callable
from itertools import count
from typing import Any

import numpy as np
import pytest

from flexslew_plant.bench.wire import Stamp, command_bytes
from flexslew_plant.direct.inbox import RecorderInput
from flexslew_plant.direct.line import DirectLine, call, facts
from flexslew_plant.direct.lines import Lines
from flexslew_plant.direct.names import address, direct
from flexslew_plant.errors import BadInput
from flexslew_plant.graph.topics import LOOP_DEPTH
from flexslew_plant.measurement import EffortCommand

numbers = count(1000 * os.getpid())  # of benches that nobody else has
NOBODY = 65534  # uid of a user without rights


@pytest.fixture
def place() -> bytes:
    return address(next(numbers), "/measurement", "/effort_command")


@pytest.fixture
def lines(place: bytes) -> Lines:
    return Lines(place, lambda: (2, 7))


def answer(tick: int = 8, name: str = "pd") -> bytes:
    return command_bytes(EffortCommand(tick, 2, name, np.array([1.0, -2.0])), Stamp(0, 0))


def greeted(lines: Lines, place: bytes, name: str = "pd") -> DirectLine:
    """Return the controller's end after both have said who they are."""
    line = call(place)
    assert line is not None
    line.notify({"controller": name})
    lines.look()
    assert facts(line.receive() or b"") == {"epoch": 2, "tick": 7}
    line.notify({"answers": True})
    assert list(lines.received()) == []
    assert name in lines.answering
    return line


def test_a_name_belongs_to_one_bench_alone() -> None:
    names = {
        address(domain, questions, answers)
        for domain in (0, 1)
        for questions in ("/measurement", "/b/measurement")
        for answers in ("/effort_command", "/b/effort_command")
    }
    assert len(names) == 8
    assert all(name[:1] == b"\0" for name in names)  # on no disk


def test_the_setting_is_auto_or_dds() -> None:
    assert direct({})
    assert direct({"FLEXSLEW_TRANSPORT": "auto"})
    assert not direct({"FLEXSLEW_TRANSPORT": "dds"})
    with pytest.raises(BadInput, match="FLEXSLEW_TRANSPORT"):
        direct({"FLEXSLEW_TRANSPORT": "pigeons"})


def test_nobody_answers_where_no_plant_listens(place: bytes) -> None:
    assert call(place) is None


def test_questions_and_answers_pass_in_their_order(lines: Lines, place: bytes) -> None:
    line = greeted(lines, place)
    for k in range(20):
        lines.send("pd", b"question %d" % k, eager=True)
    assert [line.receive() for _ in range(21)] == [*(b"question %d" % k for k in range(20)), None]
    line.send(answer(8))
    line.send(answer(9))
    assert [command.tick for command in lines.received()] == [8, 9]


def test_a_controller_that_does_not_read_holds_nobody_up_and_misses_nothing(
    lines: Lines, place: bytes
) -> None:
    slow, quick = greeted(lines, place, "slow"), greeted(lines, place, "quick")
    questions = [b"%06d" % k + bytes(300) for k in range(LOOP_DEPTH // 2)]
    for question in questions:
        lines.send("quick", question, eager=True)
        assert quick.receive() == question
    heard: list[bytes] = []
    while len(heard) < len(questions):
        found = slow.receive()
        if found is None:
            lines.look()
        else:
            heard.append(found)
    assert heard == questions


@pytest.mark.parametrize(
    "noise",
    [b"x", b"{", b"[1]", b"{}", b'{"answers": 1}', answer()[:20], answer()[:-4], b"[" * 9000,
     b"\0\1\0\0" + b"\xff" * 60, bytes(20000)],
)  # fmt: skip
def test_one_that_is_not_understood_is_hung_up_on(lines: Lines, place: bytes, noise: bytes) -> None:
    line = greeted(lines, place)
    line.send(noise)
    assert list(lines.received()) == []
    lines.look()
    assert lines.answering == set()
    assert line.receive() is None
    assert line.closed
    greeted(lines, place)  # the same may call again


@pytest.mark.parametrize("words", [b"x", b"{}", b'{"controller": 3}', b'{"controller": ""}', b"[]"])
def test_one_that_does_not_say_its_name_gets_no_line(
    lines: Lines, place: bytes, words: bytes
) -> None:
    line = call(place)
    assert line is not None
    line.send(words)
    lines.look()
    assert line.receive() is None
    assert line.closed
    assert not lines.handshake_pending


def test_of_two_with_one_name_the_older_one_keeps_its_line(lines: Lines, place: bytes) -> None:
    older = greeted(lines, place)
    younger = call(place)
    assert younger is not None
    younger.notify({"controller": "pd"})
    lines.look()
    assert younger.receive() is None
    assert younger.closed
    lines.send("pd", b"question", eager=True)
    assert older.receive() == b"question"
    older.close()
    assert list(lines.received()) == []
    lines.look()
    greeted(lines, place)


def test_the_second_plant_of_a_bench_listens_when_the_first_has_gone(place: bytes) -> None:
    first, second = Lines(place, lambda: (0, 0)), Lines(place, lambda: (2, 7))
    with pytest.raises(AssertionError):
        greeted(second, place)
    del first
    second.look()
    greeted(second, place)


def as_nobody(act: Callable[[socket.socket], None]) -> socket.socket:
    """Return a socket to a process of another user in which something is done."""
    there, here = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    if os.fork() == 0:
        try:
            os.setuid(NOBODY)
            act(there)
        except BaseException as error:  # this process must never return into the tests
            there.send(repr(error).encode())
        finally:
            os._exit(0)
    there.close()
    return here


def plant(place: bytes) -> Callable[[], object]:
    """Return what takes calls as the plant does."""
    return Lines(place, lambda: (2, 7)).look


def recorder(place: bytes) -> Callable[[], object]:
    """Return what takes calls as the recorder does."""
    inbox = RecorderInput(place, {"/truth": "/truth"}, ("_recorder", "/"))
    return lambda: list(inbox.take([]))


@pytest.mark.skipif(os.getuid() != 0, reason="only root may become somebody else")
@pytest.mark.parametrize("listening", [plant, recorder])
def test_a_process_of_another_user_gets_no_line(listening: Any, place: bytes) -> None:
    look = listening(place)

    def stranger(there: socket.socket) -> None:
        called = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        called.connect(place)
        called.send(b'{"controller": "pd", "topics": ["/truth"]}')
        there.send(b"called")
        there.send(b"has a line" if called.recv(100) else b"hung up")

    here = as_nobody(stranger)
    assert here.recv(100) == b"called"
    look()
    look()
    assert here.recv(100) in (b"hung up", b"ConnectionResetError(104, 'Connection reset by peer')")
    os.wait()


@pytest.mark.skipif(os.getuid() != 0, reason="only root may become somebody else")
def test_a_plant_of_another_user_is_not_called(place: bytes) -> None:
    def liar(there: socket.socket) -> None:
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        listener.bind(place)
        listener.listen(1)
        there.send(b"listens")
        there.recv(100)

    here = as_nobody(liar)
    assert here.recv(100) == b"listens"
    assert call(place) is None
    here.send(b"done")
    os.wait()


def test_the_copy_of_an_answer_is_known_and_no_other_one(lines: Lines, place: bytes) -> None:
    greeted(lines, place).send(answer(8))
    assert not lines.copied(answer(8))
    assert len(list(lines.received())) == 1
    assert lines.copied(answer(8))
    assert not lines.copied(answer(9))
