"""The folder of a study: samples, results in parts that are only ever added, and what it is of.

A part is written beside its place, flushed to the disk and renamed, so that a kill at any moment
leaves whole parts alone. Where a trial stands in several parts the last one counts.
"""

import errno
import json
import os
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from flexslew_lab.studies.flight import Flown
from flexslew_plant.errors import BadInput, RunFault
from flexslew_plant.file_lock import lock_file

_SAMPLES, _TABLE, _IDENTITY, _PARTS = "samples.parquet", "table.parquet", "study.json", "parts"
_LOCK = ".writing"
_GROUP = 8_192  # trials that are sorted at once


class Store:
    """Results of a study on disk.

    Args:
        folder: of the study; made when the study is created.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._identity: dict[str, Any] | None = None
        self._samples: pa.Table | None = None

    @property
    def exists(self) -> bool:
        """Whether a study has been started here."""
        return (self.folder / _IDENTITY).is_file()

    @property
    def strangers(self) -> list[str]:
        """What is in the folder and does not belong to a study."""
        own = (_SAMPLES, _PARTS, _LOCK)
        names = [path.name for path in self.folder.iterdir()] if self.folder.exists() else []
        return [name for name in names if name not in own and not name.endswith(".half")]

    @property
    def identity(self) -> dict[str, Any]:
        """What the study is of; see identity.identity_of.

        Raises:
            BadInput: the folder holds no study.
        """
        if self._identity is None:
            try:
                self._identity = json.loads((self.folder / _IDENTITY).read_text())
            except (OSError, ValueError):
                raise BadInput("holds no study", self.folder) from None
        return self._identity

    @property
    def samples(self) -> pa.Table:
        """The table of samples, see cases.sample_table."""
        if self._samples is None:
            self._samples = pq.read_table(self.folder / _SAMPLES)
        return self._samples

    @property
    def table_path(self) -> Path:
        """The sorted table."""
        return self.folder / _TABLE

    def create(self, identity: dict[str, Any], samples: pa.Table) -> None:
        """Write the samples and what they are of, before anything is flown."""
        with _told(self.folder / _PARTS):
            (self.folder / _PARTS).mkdir(parents=True, exist_ok=True)
        self._put(self.folder / _SAMPLES, lambda path: pq.write_table(samples, path))
        text = json.dumps(identity, indent=2) + "\n"
        self._put(self.folder / _IDENTITY, lambda path: path.write_text(text))

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keep others from writing here while the block runs.

        Raises:
            BadInput: somebody writes here already.
        """
        with _told(self.folder / _LOCK):
            self.folder.mkdir(parents=True, exist_ok=True)
            handle = lock_file(self.folder / _LOCK)
        if handle is None:
            raise BadInput(
                "another run of a study writes here; end it first or choose another folder "
                "with --out",
                self.folder,
            )
        try:
            yield
        finally:
            os.close(handle)

    def add(self, results: list[Flown]) -> None:
        """Write results as the next part.

        Raises:
            RunFault: the disk is full; what was written before is whole.
        """
        if not results:
            return
        rows = pa.table(
            {
                "index": pa.array([r.number for r in results], pa.int64()),
                "status": [r.status for r in results],
                "reason": [r.reason for r in results],
                "way": [r.way for r in results],
                "trajectory_hash": pa.array([r.trajectory_hash for r in results], pa.string()),
                **{
                    name: pa.array([r.metrics.get(name) for r in results], pa.float64())
                    for name in self.identity["columns"]
                },
            }
        )
        number = 1 + max((int(p.stem.split("-")[1]) for p in self._parts()), default=-1)
        part = self.folder / _PARTS / f"part-{number:06d}.parquet"
        self._put(part, lambda path: pq.write_table(rows, path))

    def adopt(self, other: "Store") -> int:
        """Add the parts of another store of the same study; return how many trials they hold."""
        count = 0
        for part in other._parts():
            rows = pq.read_table(part)
            count += rows.num_rows
            number = 1 + max((int(p.stem.split("-")[1]) for p in self._parts()), default=-1)
            place = self.folder / _PARTS / f"part-{number:06d}.parquet"
            self._put(place, partial(pq.write_table, rows))
        return count

    def statuses(self, count: int) -> NDArray[np.int8]:
        """Return 0 for every trial that is missing, 1 for ok, 2 for failed, shape (count,)."""
        found = np.zeros(count, dtype=np.int8)
        for part in self._parts():
            rows = pq.read_table(part, columns=["index", "status"])
            ok = pc.equal(rows["status"], "ok").to_numpy()
            found[rows["index"].to_numpy()] = np.where(ok, 1, 2)
        return found

    def table(self, columns: list[str], numbers: Collection[int] | None = None) -> pa.Table:
        """Return columns of the sorted table, see write_table, of all trials or of some."""
        wanted = None if numbers is None else [("index", "in", numbers)]
        return pq.read_table(self.table_path, columns=columns, filters=wanted)

    @property
    def columns(self) -> list[str]:
        """All columns of the sorted table."""
        return list(pq.read_schema(self.table_path).names)

    def write_table(self) -> Path:
        """Write the last result of every trial, sorted by number, with its sample.

        Raises:
            BadInput: no trial has been flown yet.
        """
        parts = self._parts()
        spans = [_span(part) for part in parts]
        if not spans:
            raise BadInput("no trial has been flown yet", self.folder)

        def write(path: Path) -> None:
            writer: pq.ParquetWriter | None = None
            for start in range(0, max(last for _, last in spans) + 1, _GROUP):
                end = start + _GROUP
                near = [
                    part
                    for part, (first, last) in zip(parts, spans, strict=True)
                    if first < end and last >= start
                ]
                rows = self._rows(near, start, end) if near else None
                if rows is None or not rows.num_rows:
                    continue
                if writer is None:
                    writer = pq.ParquetWriter(path, rows.schema)
                writer.write_table(rows)
            if writer is not None:
                writer.close()

        self._put(self.table_path, write)
        return self.table_path

    def _rows(self, parts: list[Path], start: int, end: int) -> pa.Table:
        """Return the last results of the trials from `start` to before `end`, sorted."""
        rows = pa.concat_tables([pq.read_table(part) for part in parts])
        numbers = rows["index"].to_numpy()
        rows = rows.filter(pa.array((numbers >= start) & (numbers < end)))
        numbers = rows["index"].to_numpy()
        _, from_behind = np.unique(numbers[::-1], return_index=True)
        rows = rows.take(pa.array(len(numbers) - 1 - from_behind))
        numbers = rows["index"].to_numpy()
        names = self.identity["variants"]
        samples = self.samples.take(pa.array(numbers // len(names)))
        head = {
            "index": rows["index"],
            "sample": samples["sample"],
            "variant": pa.array([names[k] for k in numbers % len(names)], pa.string()),
            "replicate": samples["replicate"],
            "seed": samples["seed"],
            **{name: samples[name] for name in self.identity["varied"]},
        }
        tail = {name: rows[name] for name in rows.column_names if name != "index"}
        return pa.table(head | tail)

    def write_text(self, name: str, text: str) -> Path:
        """Write a file of the study and return its path."""
        path = self.folder / name
        self._put(path, lambda place: place.write_text(text, encoding="utf-8"))
        return path

    def clean(self) -> None:
        """Take away what a kill has left half written."""
        for folder in (self.folder, self.folder / _PARTS):
            for path in folder.glob("*.half"):
                path.unlink()

    def _parts(self) -> list[Path]:
        return sorted((self.folder / _PARTS).glob("part-*.parquet"))

    def _put(self, place: Path, write: Callable[[Path], Any]) -> None:
        """Write a file whole or not at all.

        Raises:
            RunFault: the disk is full.
        """
        half = place.with_name(place.name + ".half")
        with _told(place):
            try:
                write(half)
                with half.open("rb+") as file:
                    os.fsync(file.fileno())
                half.rename(place)
                folder = os.open(place.parent, os.O_RDONLY)
                try:
                    os.fsync(folder)
                finally:
                    os.close(folder)
            except OSError:
                half.unlink(missing_ok=True)
                raise


@contextmanager
def _told(place: Path) -> Iterator[None]:
    """Say in one line why something cannot be written.

    Raises:
        RunFault: the disk is full.
        BadInput: anything else.
    """
    try:
        yield
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            raise BadInput(f"cannot be written: {error}", place) from None
        raise RunFault(
            f"{place.parent}: no space left on the disk; all results up to the last part "
            "is there; make room and run the study again"
        ) from None


def _span(part: Path) -> tuple[int, int]:
    """Return the smallest and the largest number in a part."""
    numbers = pq.read_table(part, columns=["index"])["index"].to_numpy()
    return int(numbers.min()), int(numbers.max())
