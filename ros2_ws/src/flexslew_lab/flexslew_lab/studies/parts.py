"""The results of a study in parts that are only ever added; where a trial stands in several, the
last one counts. A part that is not as it was written is named and not read.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from flexslew_lab.studies.disk import checked_folder, put, write_errors
from flexslew_lab.studies.seals import is_valid_part, part_name, part_number
from flexslew_plant.errors import BadInput
from flexslew_plant.given_file import given_bytes

TABLE = 1 << 32  # of a Parquet file of a study, at most [bytes]
_INVALID_SUFFIX = ".damaged"
HEAD = {  # of every part; the other columns are numbers
    "index": pa.int64(),
    "status": pa.string(),
    "reason": pa.string(),
    "way": pa.string(),
    "trajectory_hash": pa.string(),
}


class Parts:
    """Parts of a study on disk.

    Args:
        folder: of the parts.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._spans: dict[Path, tuple[int, int] | None] = {}  # of parts seen; None: damaged

    @property
    def damaged(self) -> list[str]:
        """The names of parts that are not as they were written."""
        return [path.name for path in self._paths() if self._span(path) is None]

    def make(self) -> None:
        """Make the folder."""
        with write_errors(self.folder):
            checked_folder(self.folder).mkdir(parents=True, exist_ok=True)

    def add(self, rows: pa.Table) -> None:
        """Write rows as the next part.

        Raises:
            RunFault: the disk is full; what was written before is whole.
        """
        content = written(rows)
        number = 1 + max((part_number(p.name) or 0 for p in self._paths()), default=-1)
        place = self.folder / part_name(number, content)
        put(place, content)
        self._spans.pop(place, None)

    def read(self, columns: list[str] | None = None) -> Iterator[pa.Table]:
        """Yield the rows of every sound part, the oldest first."""
        for path in self._paths():
            if self._span(path) is not None:
                with checked_read(path):
                    rows = pq.read_table(path, columns=columns)
                yield rows

    def spans(self) -> list[tuple[Path, int, int]]:
        """Return every sound part with the smallest and the largest number in it."""
        found = [(path, self._span(path)) for path in self._paths()]
        return [(path, *span) for path, span in found if span is not None]

    def rename_invalid(self) -> None:
        """Rename what is damaged, so that its trials are missing and are flown again."""
        for path in self._paths():
            if self._span(path) is None:
                path.rename(path.with_name(path.name + _INVALID_SUFFIX))

    def _paths(self) -> list[Path]:
        if not checked_folder(self.folder).is_dir():
            return []
        return sorted(p for p in self.folder.iterdir() if part_number(p.name) is not None)

    def _span(self, path: Path) -> tuple[int, int] | None:
        """Return the smallest and the largest number in a part; None if it is damaged."""
        if path not in self._spans:
            self._spans[path] = _span(path)
        return self._spans[path]


@contextmanager
def checked_read(path: Path) -> Iterator[None]:
    """Read a table.

    Raises:
        BadInput: it is none, or not one of a study.
    """
    try:
        yield
    except (OSError, KeyError, ValueError, pa.ArrowException) as error:
        raise BadInput(f"is damaged: {' '.join(str(error).split()):.100}", path) from None


def written(rows: pa.Table) -> bytes:
    """Return a table as a Parquet file, with checksums of its pages."""
    sink = pa.BufferOutputStream()
    pq.write_table(rows, sink, write_page_checksum=True)
    return bytes(sink.getvalue())


def read_written(content: bytes) -> pa.Table:
    """Return the table of a Parquet file, read by this thread alone.

    Where others of pyarrow read they may hold the bytes for a while: those that still do when
    Python ends abort it.
    """
    return pq.ParquetFile(pa.BufferReader(content)).read(use_threads=False)


def _span(path: Path) -> tuple[int, int] | None:
    try:
        content = given_bytes(path, TABLE)
        if not is_valid_part(path.name, content):
            return None
        rows = read_written(content)
        numbers = rows["index"].to_numpy()
    except (BadInput, OSError, KeyError, pa.ArrowException):
        return None
    kinds = {field.name: field.type for field in rows.schema}
    if any(kinds.pop(name, None) != kind for name, kind in HEAD.items()):
        return None
    if any(kind != pa.float64() for kind in kinds.values()):
        return None
    if not len(numbers) or numbers.dtype != np.int64 or numbers.min() < 0:
        return None
    return int(numbers.min()), int(numbers.max())
