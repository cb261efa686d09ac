"""Variables of a .mat file of MATLAB, versions 5 to 7.3, and of an .npz file; no objects."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexslew_lab.identification.files.columns import Choose
from flexslew_plant.errors import BadInput
from flexslew_plant.given_file import LARGEST, open_given
from flexslew_plant.mat_file import read_mat
from flexslew_plant.npz_file import LARGEST as LARGEST_NPZ
from flexslew_plant.npz_file import read_npz

_MOST = 16_000_000  # numbers of a variable


def read_mat_columns(path: Path, choose: Choose) -> dict[str, NDArray[Any]]:
    """Return variables of a .mat file.

    Raises:
        BadInput: if it is damaged or too large, a variable is missing, or none of real numbers.
    """
    open_given(path, LARGEST).close()
    try:
        names = choose(tuple(read_mat(path, (), ())))
        variables = read_mat(path, names, (), most=_MOST)
    except (OSError, ValueError) as error:
        raise BadInput(f"cannot be read: {error}", path) from None
    return {name: np.asarray(variables[name]) for name in names}


def read_npz_columns(path: Path, choose: Choose) -> dict[str, NDArray[Any]]:
    """Return arrays of an .npz file.

    Raises:
        BadInput: if it is damaged, too large, holds objects, or an array is missing.
    """
    open_given(path, LARGEST_NPZ).close()
    try:
        arrays = read_npz(path)
    except (OSError, ValueError) as error:
        raise BadInput(f"cannot be read: {error}", path) from None
    return {name: arrays[name] for name in choose(tuple(arrays))}
