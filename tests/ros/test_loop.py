"""Signals of a node's process, without a node."""

import os
import signal
from contextlib import suppress

import pytest

from flexslew_plant.ros.loop import _Interrupts, within


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_that_a_callback_has_swallowed_still_ends_the_process(
    number: signal.Signals,
) -> None:
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    interrupts = _Interrupts()
    interrupts.install()
    try:
        interrupts.raise_swallowed()
        with suppress(KeyboardInterrupt):  # as a compiler's callback does
            os.kill(os.getpid(), number)
        with pytest.raises(KeyboardInterrupt):
            interrupts.raise_swallowed()
        interrupts.taken()
        interrupts.raise_swallowed()
    finally:
        signal.signal(signal.SIGINT, before[0])
        signal.signal(signal.SIGTERM, before[1])


def test_a_namespace_becomes_a_command_line() -> None:
    assert within("") == []
    assert within("bench1") == within("/bench1/") == ["--ros-args", "-r", "__ns:=/bench1"]
