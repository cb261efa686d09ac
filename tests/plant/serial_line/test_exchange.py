"""A board in C over a bad line: no wrong answer counts, and a lost frame costs a repeat only."""

from pathlib import Path

import numpy as np
import pytest

from flexslew_plant.external.controller_link import ControllerHello, RemoteController
from flexslew_plant.external.messages import MessageKind, PlantFault, encoded
from flexslew_plant.serial_line.exchange import SESSION, Exchange, Patience
from flexslew_plant.serial_line.frames import framed

from .lines import BadLine, board

HELLO = ControllerHello(0.01, ("yaw", "pitch"), ("left", "right"), (150.0, 150.0))
KP, KD = 460.0, 920.0
PATIENT = Patience(20.0, 0.01)
SESSION_NUMBER = 0x12345678


def expected(numbers: np.ndarray) -> np.ndarray:
    """Return u = u_ff + Kp (r - q) + Kd (dr - dq), in the order of operations of the board."""
    q, v, r, dr, feedforward = (numbers[k : k + 2] for k in (0, 2, 10, 12, 14))
    return np.asarray(feedforward + KP * (r - q) + KD * (dr - v))


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_every_answer_is_that_of_its_own_question(
    share: float, case: np.random.Generator, tmp_path: Path
) -> None:
    with board(tmp_path) as (port, _, _):
        line = Exchange(BadLine(port, case, share), PATIENT)
        link = RemoteController(line, HELLO)
        assert link.name == "pd_board"
        for epoch in range(2):
            link.reset(epoch, 0, np.zeros(2))
            for tick in range(100):
                numbers = case.standard_normal(16)
                effort = link.efforts(epoch, tick, numbers)
                np.testing.assert_allclose(effort, expected(numbers), rtol=1e-15, atol=1e-12)
    assert line.count.questions == 203
    assert (line.count.repeats + line.count.damaged > 0) == (share > 0.0)


def test_a_silent_line_is_a_fault_with_its_reason() -> None:
    now = 0.0

    class Silent:
        name = "/dev/ttyX"
        written = 0

        def write(self, data: bytes) -> None:
            self.written += 1

        def read(self, timeout: float) -> bytes:
            nonlocal now
            now += max(timeout, 1e-6)
            return b""

        def close(self) -> None:
            """Nothing to close."""

    port = Silent()
    line = Exchange(port, Patience(1.0, 0.25), lambda: now)
    with pytest.raises(PlantFault, match=r"^/dev/ttyX: no answer within 1 s \(3 repeats, 0 "):
        line.ask(encoded(MessageKind.MEASUREMENT, 0, 1), MessageKind.EFFORT, 0, 1)
    assert port.written == 4
    assert now == pytest.approx(1.0, abs=1e-4)


RIGHT = encoded(MessageKind.EFFORT, 0, 5, bytes(16))


@pytest.mark.parametrize(
    ("session", "wrong"),
    [
        (SESSION_NUMBER, encoded(MessageKind.EFFORT, 0, 4, bytes(16))),
        (SESSION_NUMBER, encoded(MessageKind.EFFORT, 1, 5, bytes(16))),
        (SESSION_NUMBER, encoded(MessageKind.RESET, 0, 5)),
        (SESSION_NUMBER, b"short"),
        (SESSION_NUMBER + 1, RIGHT[:-1] + b"\1"),  # of an earlier run on the line
    ],
)
def test_an_answer_to_another_question_does_not_count(session: int, wrong: bytes) -> None:

    class Answers:
        name = "port"

        def write(self, data: bytes) -> None:
            """Answers whatever comes."""

        def read(self, timeout: float) -> bytes:
            own = SESSION.pack(SESSION_NUMBER)
            return framed(SESSION.pack(session) + wrong) + framed(own + RIGHT)

        def close(self) -> None:
            """Nothing to close."""

    line = Exchange(Answers(), session=SESSION_NUMBER)
    answer = line.ask(encoded(MessageKind.MEASUREMENT, 0, 5), MessageKind.EFFORT, 0, 5)
    assert answer == (MessageKind.EFFORT, 0, 5, bytes(16))
    assert line.count.stale == 1


def test_a_board_drops_the_questions_of_another_session(tmp_path: Path) -> None:
    with board(tmp_path) as (port, _, _):
        first = RemoteController(Exchange(port, Patience(0.2, 0.05)), HELLO)
        second = RemoteController(Exchange(port, PATIENT), HELLO)
        second.reset(0, 0, np.zeros(2))
        with pytest.raises(PlantFault, match=r"no answer within 0\.2 s"):
            first.reset(0, 0, np.zeros(2))
        second.efforts(0, 0, np.zeros(16))


def test_a_board_for_another_testbed_is_refused(tmp_path: Path) -> None:
    with board(tmp_path) as (port, _, _):
        other = HELLO._replace(tips=("left",))
        with pytest.raises(PlantFault, match="describes numbers 16; 14 is needed"):
            RemoteController(Exchange(port), other)


def test_a_board_that_has_gone_is_a_fault(tmp_path: Path) -> None:
    with board(tmp_path) as (port, _, process):
        link = RemoteController(Exchange(port, Patience(0.2, 0.05)), HELLO)
        process.kill()
        process.wait()
        with pytest.raises(PlantFault, match=r"^pty: "):
            link.efforts(0, 0, np.zeros(16))
