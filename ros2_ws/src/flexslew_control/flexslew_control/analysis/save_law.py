"""A design of python-control as controller `linear` flies it: in a file, or as keys of a trial."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexslew_control.analysis.lti import Lti
from flexslew_control.analysis.model_file import save_model
from flexslew_control.analysis.signals import on_bench
from flexslew_plant.arrays import Matrix
from flexslew_plant.errors import BadInput

if TYPE_CHECKING:
    import control

_DEFAULT_LABEL = re.compile(r"[uy]\[\d+\]")  # what python-control calls a signal without a name


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
    system, period = _sampled(system, str(file))
    names = on_bench(_as_list(inputs or system.input_labels))
    efforts = on_bench(_as_list(outputs or system.output_labels))
    _require_names(system, names, efforts, str(file))
    states = tuple(f"x.{k + 1}" for k in range(system.nstates))
    save_model(Lti(*_matrices(system), names, efforts, states, period), Path(file))


def law_of_system(
    system: "control.StateSpace | control.TransferFunction", place: str
) -> dict[str, Any]:
    """Return the key `system` of controller `linear` as plain data, its signals by their labels.

    Args:
        system: as for save_law. Where python-control has named its inputs and outputs (`u[0]`),
            they are the errors of the joints, then their rates, and the efforts of the joints.
        place: where it was given, for an error.

    Raises:
        BadInput: it is no such system, or a label is no signal's name.
    """
    system, period = _sampled(system, place)
    inputs, outputs = _user_labels(system.input_labels), _user_labels(system.output_labels)
    if inputs or outputs:
        _require_names(system, inputs, outputs, place)
    a, b, c, d = (part.tolist() for part in _matrices(system))
    found = {"a": a, "b": b, "c": c, "d": d} if a else {"d": d}
    return found | {"period": period, "inputs": list(inputs), "outputs": list(outputs)}


def _user_labels(labels: list[str]) -> tuple[str, ...]:
    """Return labels as the bench's names; none where they are those of python-control."""
    return () if all(_DEFAULT_LABEL.fullmatch(label) for label in labels) else on_bench(labels)


def _sampled(system: Any, place: str) -> "tuple[control.StateSpace, float]":
    """Return the state space and its period [s], 0 where it is continuous or has no state.

    Raises:
        BadInput: it is no state space, or its period is unspecified.
    """
    found = _state_space(system, place)
    if not found.nstates and found.dt is None:
        return found, 0.0
    if found.dt is None or found.dt is True:
        raise BadInput(f"{place}: dt is unspecified; give 0 or a period in seconds")
    return found, float(found.dt)


def _require_names(
    system: "control.StateSpace", inputs: tuple[str, ...], outputs: tuple[str, ...], place: str
) -> None:
    if len(inputs) != system.ninputs or len(outputs) != system.noutputs:
        raise BadInput(
            f"{place}: {len(inputs)} inputs and {len(outputs)} outputs are named, the system has "
            f"{system.ninputs} and {system.noutputs}"
        )
    if unknown := [name for name in (*inputs, *outputs) if "." not in name]:
        raise BadInput(f"{place}: {unknown[0]} is no signal of the bench; give inputs and outputs")


def _matrices(system: "control.StateSpace") -> tuple[Matrix, Matrix, Matrix, Matrix]:
    a, b, c, d = (
        np.asarray(part, dtype=np.float64) for part in (system.A, system.B, system.C, system.D)
    )
    return a, b, c, d


def _state_space(system: Any, place: str) -> "control.StateSpace":
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
        raise BadInput(words, place) from None


def _as_list(names: Sequence[str] | str) -> list[str]:
    return [names] if isinstance(names, str) else list(names)
