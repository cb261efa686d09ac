"""Files of measurements of others: one table of readers by suffix."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TypeAlias

from flexslew_lab.identification.files.arrays import read_mat_columns, read_npz_columns
from flexslew_lab.identification.files.bag import read_bag
from flexslew_lab.identification.files.columns import Columns, FileClock
from flexslew_lab.identification.files.csv_file import read_csv
from flexslew_lab.identification.files.parquet import read_parquet
from flexslew_lab.identification.files.table import table_columns
from flexslew_lab.identification.files.uff import read_uff
from flexslew_plant.errors import BadInput

Reader: TypeAlias = Callable[[Path, list[str], FileClock], Columns]

_CSV, _UFF = partial(table_columns, read_csv), read_uff
READERS: dict[str, Reader] = {
    ".csv": _CSV,
    ".txt": _CSV,
    ".tsv": _CSV,
    ".dat": _CSV,
    ".mat": partial(table_columns, read_mat_columns),
    ".npz": partial(table_columns, read_npz_columns),
    ".parquet": partial(table_columns, read_parquet),
    ".uff": _UFF,
    ".unv": _UFF,
    ".58": _UFF,
    ".mcap": read_bag,
    ".db3": read_bag,
}


def read_columns(path: Path, names: list[str], clock: FileClock) -> Columns:
    """Return series of a file, or of the folder of a bag, by their names.

    Args:
        path: its suffix is one of READERS, in any case; a folder is a bag.
        names: of the columns, `name`, `name[index]`, or of a bag `/topic.field[index]`.
        clock: how times are read.

    Raises:
        BadInput: if the format is unknown, the file cannot be read, or a column is missing.
    """
    if path.is_dir():
        return read_bag(path, names, clock)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        allowed = ", ".join(READERS)
        raise BadInput(f"cannot be read: {path.suffix or 'no suffix'}; allowed are {allowed}, or "
                       "the folder of a bag", path)  # fmt: skip
    return reader(path, names, clock)
