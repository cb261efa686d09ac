"""A bag whose writer is interrupted: at every single line of it, the file is whole."""

import signal
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import Any

import pytest
from mcap.reader import make_reader

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.recording.bag_writer import BagWriter
from flexslew_plant.processes.atomic import atomic

RECORDING = str(Path(sys.modules[BagWriter.__module__].__file__ or "").parent)
DATA = b"\0\1\0\0" + bytes(16)


@pytest.fixture(autouse=True)
def interrupts() -> Iterator[None]:
    before = signal.signal(signal.SIGINT, lambda *_: atomic.interrupt())
    yield
    signal.signal(signal.SIGINT, before)


class InterruptAt:
    """Raises the signal at the n-th line that runs below a folder of the code; counts them."""

    def __init__(self, folder: str, at: int) -> None:
        self.folder, self.at, self.lines = folder, at, 0

    def __call__(self, frame: FrameType, event: str, argument: Any) -> Any:
        if not frame.f_code.co_filename.startswith(self.folder):
            return None
        if event == "line":
            self.lines += 1
            if self.lines == self.at:
                signal.raise_signal(signal.SIGINT)
        return self

    def __enter__(self) -> "InterruptAt":
        sys.settrace(self)
        return self

    def __exit__(self, *error: object) -> None:
        sys.settrace(None)


def write(folder: Path, at: int) -> int:
    """Write two chunks of two topics, interrupted at a line; return how many lines it took."""
    with (
        BagWriter(folder, {"trial": ""}) as writer,
        InterruptAt(str(Path(RECORDING).parent), at) as trace,
        suppress(KeyboardInterrupt),
    ):
        for stamp in range(4):
            writer.write("/own", "builtin_interfaces/msg/Time", DATA[:12], stamp)
            writer.write("/clock", "rosgraph_msgs/msg/Clock", DATA[:12], stamp)
            if stamp == 1:
                writer.flush()
        writer.flush()
        writer.close({"messages": str(writer.messages)})
    return trace.lines


@pytest.mark.slow
def test_an_interrupt_at_any_line_leaves_whole_messages_chunks_and_files(tmp_path: Path) -> None:
    lines = write(tmp_path / "whole", 0)
    assert lines > 150
    counts = set()
    for at in range(1, lines + 1):
        folder = tmp_path / str(at)
        write(folder, at)
        reader = BagReader(folder)
        with (folder / f"{at}_0.mcap").open("rb") as stream:
            theirs = make_reader(stream, validate_crcs=True)
            stamps = [m.log_time for _, _, m in theirs.iter_messages()]
        assert [m.stamp for m in reader.messages()] == stamps
        counts.add(len(stamps))
    assert counts == {*range(9)}  # the interrupt has really cut the work short


def interrupted_within(blocks: int, times: int, reached: list[int]) -> None:
    """Send signals in the innermost of some blocks; tell which blocks were left."""
    with atomic:
        if blocks > 1:
            interrupted_within(blocks - 1, times, reached)
        else:
            for _ in range(times):
                signal.raise_signal(signal.SIGINT)
        reached.append(blocks)


def test_an_interrupt_waits_for_the_outermost_block_and_comes_once() -> None:
    reached: list[int] = []
    with pytest.raises(KeyboardInterrupt):
        interrupted_within(3, 2, reached)
    assert reached == [1, 2, 3]
    with atomic:
        pass


@pytest.mark.slow
def test_who_cannot_wait_any_longer_is_interrupted_in_the_block() -> None:
    reached: list[int] = []
    with pytest.raises(KeyboardInterrupt):
        interrupted_within(1, 10**9, reached)
    assert reached == []
