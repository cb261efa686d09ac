"""The bag of a recorder that was killed, in which one that is started again goes on."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from flexslew_lab.log.bag_layout import METADATA_FILE, TOPICS
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.files.bag_lock import lock_folder, release_folder
from flexslew_lab.log.recording.bag_writer import BagWriter
from flexslew_lab.log.recording.recording_order import tick_and_epoch
from flexslew_plant.errors import BadInput

BEFORE_START = (0, -1)  # epoch and tick before all others
_LEFT = ".mcap.left"  # suffix of what was left, while it is copied


class StartedBag(NamedTuple):
    """What a bag holds already."""

    writer: BagWriter
    last: tuple[int, int] = BEFORE_START  # epoch and tick of the newest question in it
    received: frozenset[tuple[str, bytes]] = (
        frozenset()
    )  # sent again to late subscribers: topic, CDR


def open_bag(folder: Path, metadata: Mapping[str, str]) -> StartedBag:
    """Return the writer of a new bag, or of one that a recorder of the same run left unfinished.

    What was left is copied, up to its last whole chunk; a bag that was finished stays as it is.

    Args:
        folder: of the bag.
        metadata: of the run, see BagWriter.

    Raises:
        BadInput: the folder holds another bag, or another recorder writes there.
        RecordingStopped: it cannot be written.
    """
    path = folder / f"{folder.resolve().name}_0.mcap"
    left = path.with_suffix(_LEFT)
    copy_exists = left.exists()  # killed again, while it was copied
    if (folder / METADATA_FILE).exists() or not (copy_exists or _is_of(path, metadata)):
        return StartedBag(BagWriter(folder, metadata))
    handle = lock_folder(folder)
    try:
        if copy_exists:
            path.unlink(missing_ok=True)
        else:
            path.rename(left)
    finally:
        release_folder(handle, folder)
    bag = _copied(left, BagWriter(folder, metadata))
    left.unlink()
    return bag


def _is_of(path: Path, metadata: Mapping[str, str]) -> bool:
    """Return whether a file is of a run with this metadata, and was not finished."""
    try:
        reader = BagReader(path, external=True)
        for _ in reader.messages(()):
            pass
    except BadInput:
        return False
    known = {k: v for k, v in reader.metadata.items() if k not in ("format", "checksum")}
    return reader.cut is not None and known == dict(metadata)


def _copied(left: Path, writer: BagWriter) -> StartedBag:
    last, received = BEFORE_START, set[tuple[str, bytes]]()
    for topic, kind, stamp, _, data in BagReader(left, external=True).messages():
        writer.write(topic, kind, data, stamp)
        if topic == "/measurement":
            tick, epoch = tick_and_epoch(data)
            last = max(last, (epoch, tick))
        elif TOPICS[topic].latched:
            received.add((topic, data))
    writer.flush()
    return StartedBag(writer, last, frozenset(received))
