"""The folder of a study: samples, results in parts, the table of both, and its identity.

Every file is written next to its place, flushed to the disk and renamed, so that a kill at any
moment leaves whole files alone; a file that is read again carries its SHA-256.
"""

import hashlib
import os
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from flexslew_lab.metrics import Key
from flexslew_lab.studies.disk import HALF, checked_folder, put, write_errors
from flexslew_lab.studies.flight import FlightResult
from flexslew_lab.studies.identity_file import (
    IDENTITY,
    KeptIdentity,
    identity_text,
    kept_identity,
)
from flexslew_lab.studies.parts import TABLE, Parts, checked_read, read_written, written
from flexslew_lab.studies.seals import check_text, json_with_digest, text_with_digest
from flexslew_plant.errors import BadInput
from flexslew_plant.given_file import given_bytes
from flexslew_plant.processes.file_lock import lock_file
from flexslew_plant.settings import validated

_SAMPLES, _TABLE, _PARTS = "samples.parquet", "table.parquet", "parts"
_DESCRIPTION = ("study.yaml", "trial.yaml")
_LOCK = ".writing"
_GROUP = 8_192  # trials that are sorted at once


class Store:
    """Results of a study on disk.

    Args:
        folder: of the study; made when the study is created.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._stored: KeptIdentity | None = None
        self._samples: pa.Table | None = None
        self._table: tuple[tuple[int, ...], pq.ParquetFile] | None = None  # as it stood, opened
        self._parts = Parts(folder / _PARTS)

    @property
    def exists(self) -> bool:
        """Whether a study has been started here."""
        return os.path.isfile(self.folder / IDENTITY)

    @property
    def unknown_items(self) -> list[str]:
        """What is in the folder and does not belong to a study.

        Raises:
            BadInput: it is no folder, or cannot be read.
        """
        known_names = (_SAMPLES, _PARTS, _LOCK)
        try:
            names = os.listdir(self.folder) if os.path.lexists(self.folder) else []
        except OSError as error:
            raise BadInput(f"is no folder of a study: {error.strerror}", self.folder) from None
        return [name for name in names if name not in known_names and not name.endswith(HALF)]

    @property
    def damaged(self) -> list[str]:
        """The parts that are not as they were written; their trials count as not flown."""
        return self._parts.damaged

    @property
    def identity(self) -> dict[str, Any]:
        """What the study is of; see identity.identity_of.

        Raises:
            BadInput: the folder holds no study, or that file is damaged.
        """
        return self._identity.identity

    @property
    def _identity(self) -> KeptIdentity:
        if self._stored is None:
            self._stored = kept_identity(self.folder)
        return self._stored

    @property
    def samples(self) -> pa.Table:
        """The table of samples, see cases.sample_table.

        Raises:
            BadInput: the file is damaged.
        """
        if self._samples is None:
            needed = {"sample", "replicate", "seed", *self.identity["varied"]}
            path = self.folder / _SAMPLES
            try:
                content = given_bytes(path, TABLE)
                found = read_written(content)
            except (BadInput, OSError, pa.ArrowException):
                found, content = None, b""
            digest = hashlib.sha256(content).hexdigest()
            if (
                found is None
                or digest != (self._identity.samples_sha256 or digest)
                or not needed <= set(found.column_names)
            ):
                raise BadInput(
                    f"{path}: is damaged; take it from a copy, or move the folder away and run the "
                    "study again"
                )
            self._samples = found
        return self._samples

    @property
    def user_keys(self) -> dict[str, Key]:
        """What the keys of metrics of the trial's own hold.

        Raises:
            BadInput: their description is of no use.
        """
        path = self.folder / IDENTITY
        found: dict[str, Key] = validated(dict[str, Key], self.identity.get("keys", {}), str(path))
        return found

    @property
    def table_path(self) -> Path:
        """The sorted table."""
        return self.folder / _TABLE

    @property
    def description(self) -> Path:
        """The study's file in the folder, after checking it and its trial's.

        Raises:
            BadInput: one of them is damaged.
        """
        for name in _DESCRIPTION:
            check_text(self.folder / name)
        return self.folder / _DESCRIPTION[0]

    def create(self, identity: dict[str, Any], samples: pa.Table) -> None:
        """Write the samples and what they are of, before anything of them is flown."""
        self._parts.make()
        content = written(samples)
        put(self.folder / _SAMPLES, content)
        self._stored = KeptIdentity(identity, hashlib.sha256(content).hexdigest())
        put(self.folder / IDENTITY, identity_text(self._stored).encode())

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keep other processes from writing here while the block runs.

        Raises:
            BadInput: if another process writes here already.
        """
        with write_errors(self.folder / _LOCK):
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

    def add(self, results: list[FlightResult]) -> None:
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
        self._parts.add(rows)

    def adopt(self, other: "Store") -> int:
        """Add the sound parts of another store of the same study; return how many trials."""
        count = 0
        for rows in other._parts.read():
            count += rows.num_rows
            self._parts.add(rows)
        return count

    def statuses(self, count: int) -> NDArray[np.int8]:
        """Return 0 for every trial that is missing, 1 for ok, 2 for failed, shape (count,).

        Raises:
            BadInput: a part holds trials that the study does not have.
        """
        self._spans(count)
        found = np.zeros(count, dtype=np.int8)
        for rows in self._parts.read(["index", "status"]):
            ok = pc.equal(rows["status"], "ok").to_numpy()
            found[rows["index"].to_numpy()] = np.where(ok, 1, 2)
        return found

    def table(self, columns: list[str], numbers: Collection[int] | None = None) -> pa.Table:
        """Return columns of the sorted table, see write_table, of all trials or of some.

        Raises:
            BadInput: the table is damaged.
        """
        try:
            if numbers is None:
                return self._opened().read(columns).select(columns)
            requested = [("index", "in", numbers)]
            return pq.read_table(
                self.table_path, columns=columns, filters=requested, page_checksum_verification=True
            )
        except (OSError, KeyError, pa.ArrowException):
            raise BadInput(
                f"{self.table_path}: is damaged; ./flexslew study report {self.folder} writes it "
                "again"
            ) from None

    def _opened(self) -> pq.ParquetFile:
        """Return the sorted table as it is now: to open it takes as long as ten columns do."""
        state = os.stat(self.table_path)
        now = state.st_ino, state.st_mtime_ns, state.st_size
        if self._table is None or self._table[0] != now:
            self._table = now, pq.ParquetFile(self.table_path, page_checksum_verification=True)
        return self._table[1]

    @property
    def columns(self) -> list[str]:
        """All columns of the sorted table."""
        with checked_read(self.table_path):
            return list(self._opened().schema_arrow.names)

    def write_table(self) -> Path:
        """Write the last result of every trial, sorted by number, with its sample.

        Raises:
            BadInput: no trial has been flown yet.
        """
        spans = self._spans(self.samples.num_rows * len(self.identity["variants"]))
        if not spans:
            lost = "".join(f"; {name} is damaged" for name in self.damaged)
            raise BadInput(f"no trial has been flown yet{lost}", self.folder)
        sink = pa.BufferOutputStream()
        writer: pq.ParquetWriter | None = None
        for start in range(0, max(last for _, _, last in spans) + 1, _GROUP):
            end = start + _GROUP
            near = [path for path, first, last in spans if first < end and last >= start]
            with checked_read(self.folder):
                rows = self._rows(near, start, end) if near else None
            if rows is None or not rows.num_rows:
                continue
            if writer is None:
                writer = pq.ParquetWriter(sink, rows.schema, write_page_checksum=True)
            writer.write_table(rows)
        if writer is not None:
            writer.close()
        put(self.table_path, sink.getvalue())
        return self.table_path

    def _spans(self, count: int) -> list[tuple[Path, int, int]]:
        """Return the sound parts, each with its smallest and largest number.

        Raises:
            BadInput: one holds a trial that the study of `count` trials does not have.
        """
        spans = self._parts.spans()
        for path, _, last in spans:
            if last >= count:
                raise BadInput(f"trial {last} is not one of 0 to {count - 1}", path)
        return spans

    def _rows(self, parts: list[Path], start: int, end: int) -> pa.Table:
        """Return the last results of the trials from `start` to before `end`, sorted."""
        names = self.identity["variants"]
        rows = pa.concat_tables([pq.read_table(part) for part in parts])
        numbers = rows["index"].to_numpy()
        rows = rows.filter(pa.array((numbers >= start) & (numbers < end)))
        numbers = rows["index"].to_numpy()
        _, last_index = np.unique(numbers[::-1], return_index=True)
        rows = rows.take(pa.array(len(numbers) - 1 - last_index))
        numbers = rows["index"].to_numpy()
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
        put(path, (text_with_digest(text) if name in _DESCRIPTION else text).encode())
        return path

    def write_facts(self, name: str, facts: dict[str, Any]) -> None:
        """Write a JSON file of the study."""
        put(self.folder / name, json_with_digest(facts).encode())

    def clean(self) -> None:
        """Take away what a kill has left half written, and set aside what is damaged."""
        for folder in (self.folder, checked_folder(self.folder / _PARTS)):
            for path in folder.glob(f"*{HALF}"):
                path.unlink()
        self._parts.rename_invalid()
