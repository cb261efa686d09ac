"""A design of python-control as a file that controller `linear` flies."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexslew_control.analysis.lti import Lti
from flexslew_control.analysis.model_file import save_model
from flexslew_control.analysis.signals import on_bench
from flexslew_plant.errors import BadInput

if TYPE_CHECKING:
    import control


def save_law(
    system: "control.StateSpace | control.TransferFunction",
    file: str | Path,
    inputs: Sequence[str] | str | None = None,
    outputs: Sequence[str] | str | None = None,
) -> None:
    """Write a controller to a file: `controllers: {linear: {file: ...}}` flies it.

    Args:
        system: from signals to efforts, continuous or discrete; positive, as u = K e. A state
            space, or what `control.ss` makes one of: a transfer function of one input and output.
        file: ends in .mat, .npz, .yaml or .json.
        inputs: signals by name (`error.JOINT`, `rate.JOINT`, `tip.APPENDAGE`, ...); None: the
            system's own labels.
        outputs: `effort.JOINT`; None: the system's own labels.

    Raises:
        BadInput: it is no such system, or the file cannot be written.
    """
    system = _state_space(system, file)
    if system.dt is None or system.dt is True:
        raise BadInput(f"{file}: dt is unspecified; give 0 or a period in seconds")
    names = on_bench(_listed(inputs or system.input_labels))
    efforts = on_bench(_listed(outputs or system.output_labels))
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


def _state_space(system: Any, file: str | Path) -> "control.StateSpace":
    import control

    if isinstance(system, control.StateSpace):
        return system
    try:
        if not isinstance(system, control.TransferFunction):
            raise TypeError(f"it is a {type(system).__name__}")
        return control.ss(system)
    except (TypeError, ValueError, NotImplementedError, control.ControlArgument) as error:
        words = (
            f"is no state space ({error}); join proper parts: control.append(control.ss(part), ...)"
        )
        raise BadInput(words, file) from None


def _listed(names: Sequence[str] | str) -> list[str]:
    return [names] if isinstance(names, str) else list(names)
