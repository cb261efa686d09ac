"""Columns of a Parquet file."""

from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from flexslew_lab.identification.files.columns import Choose
from flexslew_plant.errors import BadInput
from flexslew_plant.extras import required
from flexslew_plant.given_file import open_given

LARGEST = 1 << 30  # of the columns that are read, unpacked [B]


def read_parquet(path: Path, choose: Choose) -> dict[str, NDArray[Any]]:
    """Return columns of a Parquet file; times of a calendar stay such.

    Raises:
        BadInput: if it is damaged or too large, a column is missing or has entries without values.
        ModuleNotFoundError: if pyarrow is missing.
    """
    required("pyarrow")
    import pyarrow.parquet as parquet

    try:
        with open_given(path, LARGEST) as file:
            table = parquet.ParquetFile(file)
            names = choose(tuple(table.schema_arrow.names))
            _check_size(path, table, len(names))
            read = table.read(columns=list(names), use_threads=False)
            for name in names:
                if read.column(name).null_count:
                    raise BadInput(f"{name} has entries without a value", path)
            return {name: read.column(name).to_numpy() for name in names}
    except BadInput:
        raise
    except Exception as error:  # damaged bytes meet a parser with errors of many kinds
        raise BadInput(f"cannot be read: {error or type(error).__name__}", path) from None


def _check_size(path: Path, table: Any, columns: int) -> None:
    """Require columns that fit in memory."""
    metadata = table.metadata
    groups = (metadata.row_group(k) for k in range(metadata.num_row_groups))
    size = max(8 * metadata.num_rows * columns, sum(group.total_byte_size for group in groups))
    if not 0 <= size <= LARGEST:
        raise BadInput(f"it unpacks to {size >> 20:,} MiB; at most {LARGEST >> 20} are read", path)
