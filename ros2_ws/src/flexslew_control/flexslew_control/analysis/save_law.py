"""A design of python-control as a file that controller `linear` flies."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from flexslew_control.analysis.lti import Lti
from flexslew_control.analysis.model_file import save_model
from flexslew_control.analysis.signals import on_bench
from flexslew_plant.errors import BadInput

if TYPE_CHECKING:
    import control


def save_law(
    system: "control.StateSpace",
    file: str | Path,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
) -> None:
    """Write a controller to a file: `controllers: {linear: {file: ...}}` flies it.

    Args:
        system: from signals to efforts, continuous or discrete; positive, as u = K e.
        file: ends in .mat, .npz, .yaml or .json.
        inputs: signals by name (`error.JOINT`, `rate.JOINT`, `tip.APPENDAGE`, ...); None: the
            system's own labels.
        outputs: `effort.JOINT`; None: the system's own labels.

    Raises:
        BadInput: it is no such system, or the file cannot be written.
    """
    if system.dt is None or system.dt is True:
        raise BadInput(f"{file}: dt is unspecified; give 0 or a period in seconds")
    names = on_bench(list(inputs or system.input_labels))
    efforts = on_bench(list(outputs or system.output_labels))
    if len(names) != system.ninputs or len(efforts) != system.noutputs:
        raise BadInput(
            f"{file}: {len(names)} inputs and {len(efforts)} outputs are named, the system has "
            f"{system.ninputs} and {system.noutputs}"
        )
    if unnamed := [name for name in (*names, *efforts) if "." not in name]:
        raise BadInput(f"{file}: {unnamed[0]} is no signal of the bench; give inputs and outputs")
    a, b, c, d = (np.asarray(part, dtype=np.float64)
                  for part in (system.A, system.B, system.C, system.D))  # fmt: skip
    states = tuple(f"x.{k + 1}" for k in range(len(a)))
    save_model(Lti(a, b, c, d, names, efforts, states, float(system.dt)), Path(file))
