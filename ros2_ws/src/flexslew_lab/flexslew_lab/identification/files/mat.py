"""Variables of a .mat file of MATLAB, versions 5 to 7.3, without its objects."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexslew_lab.identification.files.columns import Choose
from flexslew_plant.errors import BadInput
from flexslew_plant.given_file import LARGEST, open_given
from flexslew_plant.mat_file import read_mat

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
