"""Linear systems in files that MATLAB, NumPy and everything else read."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import savemat

from flexslew_control.analysis.lti import Lti, plain
from flexslew_plant.errors import BadInput
from flexslew_plant.yaml_data import yaml_text


def save_model(system: Lti, path: Path) -> None:
    """Write A, B, C, D, Ts (0: continuous) and the names of inputs, outputs and states.

    Args:
        system: to write.
        path: ends in .mat (MATLAB 5), .npz, .json or .yaml.

    Raises:
        BadInput: another ending, or the file cannot be written.
    """
    write = _WRITERS.get(path.suffix)
    if write is None:
        raise BadInput(f"give a name that ends in {', '.join(_WRITERS)}", path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write(system, path)
    except OSError as error:
        raise BadInput(f"cannot be written: {error.strerror}", path) from None


def _mat(system: Lti, path: Path) -> None:
    names = {key: np.array(getattr(system, key), dtype=object) for key in _NAMES}
    savemat(path, _matrices(system) | names)


def _npz(system: Lti, path: Path) -> None:
    names: dict[str, Any] = {key: np.array(getattr(system, key), dtype=str) for key in _NAMES}
    np.savez(path, **names, **_matrices(system))


def _json(system: Lti, path: Path) -> None:
    path.write_text(json.dumps(plain(system), indent=1), encoding="utf-8")


def _yaml(system: Lti, path: Path) -> None:
    path.write_text(yaml_text(plain(system)), encoding="utf-8")


def _matrices(system: Lti) -> dict[str, Any]:
    return {
        "A": system.a, "B": system.b, "C": system.c, "D": system.d, "Ts": np.array(system.period)
    }  # fmt: skip


_NAMES = ("inputs", "outputs", "states")
_WRITERS: dict[str, Callable[[Lti, Path], None]] = {
    ".mat": _mat,
    ".npz": _npz,
    ".json": _json,
    ".yaml": _yaml,
}
