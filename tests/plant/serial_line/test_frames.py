"""Frames on a serial line: whole messages or none."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexslew_plant.serial_line.frames import Deframer, cobs_decoded, cobs_encoded, framed

LARGEST = 5000


@given(st.binary(max_size=1200))
def test_the_code_has_no_zero_and_gives_the_bytes_back(data: bytes) -> None:
    code = cobs_encoded(data)
    assert 0 not in code
    assert len(code) <= len(data) + len(data) // 254 + 1
    assert cobs_decoded(code) == data


@pytest.mark.parametrize(
    ("data", "code"),
    [  # examples of the paper's method, by hand
        (b"", b"\x01"),
        (b"\0", b"\x01\x01"),
        (b"\x11\x22\0\x33", b"\x03\x11\x22\x02\x33"),
        (b"\x01" * 254, b"\xff" + b"\x01" * 254),
        (b"\x01" * 254 + b"\0", b"\xff" + b"\x01" * 254 + b"\x01\x01"),
        (b"\x01" * 255, b"\xff" + b"\x01" * 254 + b"\x02\x01"),
    ],
)
def test_codes_are_those_of_the_method(data: bytes, code: bytes) -> None:
    assert cobs_encoded(data) == code


def test_messages_come_whole_however_the_line_cuts_them(case: np.random.Generator) -> None:
    messages = [case.bytes(int(case.integers(1, 700))) for _ in range(20)]
    stream = b"".join(framed(each) + b"\x07noise" * int(case.integers(2)) for each in messages)
    deframer, received, at = Deframer(LARGEST), list[bytes](), 0
    while at < len(stream):
        step = int(case.integers(1, 50))
        received += deframer.take(stream[at : at + step])
        at += step
    assert received == messages


def test_no_damaged_frame_is_a_message(case: np.random.Generator) -> None:
    """Bits flip, bytes get lost or appear: CRC-32 detects them."""
    message = case.bytes(120)
    for _ in range(300):
        frame = bytearray(framed(message))
        at = int(case.integers(1, len(frame) - 1))
        match case.integers(3):
            case 0:
                frame[at] ^= 1 << int(case.integers(8))
            case 1:
                del frame[at : at + int(case.integers(1, 5))]
            case _:
                frame[at:at] = case.bytes(int(case.integers(1, 5)))
        got = Deframer(LARGEST).take(bytes(frame) + b"\0")
        assert got in ([], [message])


def test_a_frame_that_never_ends_takes_no_memory() -> None:
    deframer = Deframer(100)
    for _ in range(1000):
        assert deframer.take(b"\x05" * 50) == []
    assert deframer.take(b"\0" + framed(b"next")) == [b"next"]
    assert deframer.damaged == 1
