"""Readers of finite element models, by the ending of the file."""

from collections.abc import Callable
from pathlib import Path

from flexslew_plant.errors import BadInput
from flexslew_plant.given_file import MIB, given_bytes
from flexslew_plant.testbeds.spacecraft.finite_elements.model import FiniteElementModel
from flexslew_plant.testbeds.spacecraft.finite_elements.readers.arrays import mat_model, npz_model
from flexslew_plant.testbeds.spacecraft.finite_elements.readers.calculix import (
    ENDINGS as CALCULIX,
)
from flexslew_plant.testbeds.spacecraft.finite_elements.readers.calculix import calculix_model
from flexslew_plant.testbeds.spacecraft.finite_elements.readers.op4 import op4_model

LARGEST = 256 * MIB  # of a file [bytes]
_READERS: dict[str, tuple[tuple[str, ...], Callable[[Path, dict[str, bytes]], FiniteElementModel]]]
_READERS = {
    ".npz": ((), npz_model),
    ".mat": ((), mat_model),
    ".op4": ((), op4_model),
    **dict.fromkeys(CALCULIX, (CALCULIX, calculix_model)),
}


def files_of(path: Path) -> list[Path]:
    """Return the files that are read where one of this name is: itself, or those of its model."""
    beside, _ = _READERS.get(path.suffix.lower(), ((), None))
    return [path.with_suffix(ending) for ending in beside] or [path]


def contents_of(path: Path) -> dict[str, bytes]:
    """Return the content of the files of a model, by ending.

    Raises:
        BadInput: the ending is unknown, or a file cannot be read.
    """
    if path.suffix.lower() not in _READERS:
        words = f"a finite element model ends in {', '.join(_READERS)}"
        raise BadInput(words, path, value=path.suffix)
    return {file.suffix: given_bytes(file, LARGEST) for file in files_of(path)}


def read_model(path: Path, contents: dict[str, bytes]) -> FiniteElementModel:
    """Return the model of a file, in its units.

    Raises:
        BadInput: its content is not a model.
    """
    return _READERS[path.suffix.lower()][1](path, contents)
