"""Readers of finite element models, by the ending of the file."""

import os
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
from flexslew_plant.testbeds.spacecraft.finite_elements.readers.nastran import (
    BESIDE,
    OUTPUT2,
    PUNCH,
    output2_model,
    punch_model,
)
from flexslew_plant.testbeds.spacecraft.finite_elements.readers.op4 import op4_model

LARGEST = 256 * MIB  # of a file [bytes]
MODES = (".frd", ".dat")  # files of clamped modes, which `clamped_modes` reads, by the first
_READERS: dict[str, tuple[tuple[str, ...], Callable[[Path, dict[str, bytes]], FiniteElementModel]]]
_READERS = {
    ".npz": ((), npz_model),
    ".mat": ((), mat_model),
    ".op4": ((), op4_model),
    OUTPUT2: ((), output2_model),
    PUNCH: ((), punch_model),
    **dict.fromkeys(CALCULIX, (CALCULIX, calculix_model)),
}


MODEL_ENDINGS = tuple(dict.fromkeys((*_READERS, *MODES, *BESIDE)))  # of all files of models


def files_of(path: Path) -> list[Path]:
    """Return the files that are read where one of this name is: itself, or those of its model."""
    ending = path.suffix.lower()
    beside = MODES if ending == MODES[0] else _READERS.get(ending, ((), None))[0]
    files = [path.with_suffix(ending) for ending in beside] or [path]
    if ending == PUNCH:
        files += [file for file in map(path.with_suffix, BESIDE) if os.path.isfile(file)]
    return files


def contents_of(path: Path) -> dict[str, bytes]:
    """Return the content of the files of a model, by ending.

    Raises:
        BadInput: the ending is unknown, or a file cannot be read.
    """
    if path.suffix.lower() not in (*_READERS, MODES[0]):
        words = f"a finite element model ends in {', '.join((*_READERS, MODES[0]))}"
        raise BadInput(words, path, value=path.suffix)
    return {file.suffix: given_bytes(file, LARGEST) for file in files_of(path)}


def read_model(path: Path, contents: dict[str, bytes]) -> FiniteElementModel:
    """Return the model of a file, in its units.

    Raises:
        BadInput: its content is not a model.
    """
    return _READERS[path.suffix.lower()][1](path, contents)
