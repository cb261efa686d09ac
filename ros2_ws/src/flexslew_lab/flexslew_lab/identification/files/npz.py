"""Arrays of an .npz file of NumPy, without pickled objects."""

from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from flexslew_lab.identification.files.columns import Choose
from flexslew_plant.errors import BadInput
from flexslew_plant.given_file import open_given
from flexslew_plant.npz_file import LARGEST, read_npz


def read_npz_columns(path: Path, choose: Choose) -> dict[str, NDArray[Any]]:
    """Return arrays of an .npz file.

    Raises:
        BadInput: if it is damaged, too large, holds objects, or an array is missing.
    """
    open_given(path, LARGEST).close()
    try:
        arrays = read_npz(path)
    except (OSError, ValueError) as error:
        raise BadInput(f"cannot be read: {error}", path) from None
    return {name: arrays[name] for name in choose(tuple(arrays))}
