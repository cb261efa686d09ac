"""Signals of a node's process, without a node."""

import os
import signal
from collections.abc import Iterator
from contextlib import suppress
from threading import Event

import pytest

from flexslew_plant.ros.interrupts import Interrupts
from tests.present import present


@pytest.fixture
def interrupts() -> Iterator[Interrupts]:
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    one = Interrupts()
    one.install()
    yield one
    one.ignore()
    signal.signal(signal.SIGINT, before[0])
    signal.signal(signal.SIGTERM, before[1])


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_that_a_callback_has_swallowed_comes_again(
    interrupts: Interrupts, number: signal.Signals
) -> None:
    with suppress(KeyboardInterrupt):  # as a compiler's callback does
        os.kill(os.getpid(), number)
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            Event().wait(20.0)


def test_a_signal_that_was_taken_does_not_come_again(interrupts: Interrupts) -> None:
    with suppress(KeyboardInterrupt):
        os.kill(os.getpid(), signal.SIGINT)
    timer = present(interrupts._again)
    interrupts.taken()
    timer.join(20.0)
    assert not timer.is_alive()  # cancelled, it ended without a signal
    assert interrupts._again is None
