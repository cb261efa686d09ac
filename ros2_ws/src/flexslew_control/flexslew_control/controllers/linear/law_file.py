"""A linear controller from a file that python-control, MATLAB, NumPy or a person wrote."""

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from flexslew_control.controllers.linear.mat_file import read_mat
from flexslew_plant.errors import BadInput
from flexslew_plant.given_file import given_bytes, given_text
from flexslew_plant.npz_file import read_npz
from flexslew_plant.yaml_data import load_yaml

_KEYS = {"A": "a", "B": "b", "C": "c", "D": "d", "Ts": "period"}
_NAMES = ("inputs", "outputs")
# by what readers say that a file is none of theirs, or damaged
_DAMAGED = (ValueError, TypeError)
_ENDINGS = (".mat", ".npz", ".yaml", ".yml", ".json")


def law_from_file(path: str, source: str) -> dict[str, Any]:
    """Return the key `system` of controller `linear` as a file holds it, plain data.

    Args:
        path: .mat of MATLAB's version 5 to 7, .npz, .yaml or .json with A, B, C, D, Ts (0:
            continuous) and, if it has them, inputs and outputs.
        source: the file or node that names it, for an error.

    Raises:
        BadInput: it cannot be read, or holds no such system.
    """
    place = Path(path)
    if place.suffix not in _ENDINGS:
        raise BadInput(f"{source}: file: {path}: give a file that ends in {', '.join(_ENDINGS)}")
    try:
        values = _read(place)
    except BadInput as error:
        raise BadInput(f"{source}: file: {error}") from None
    except OSError as error:
        raise BadInput(f"{source}: file: {path}: cannot be read: {error.strerror}") from None
    except _DAMAGED as error:
        raise BadInput(f"{source}: file: {path}: cannot be read: {error}") from None
    # every key, so that nothing is left of a system that this one replaces
    system: dict[str, Any] = {"a": [], "b": [], "c": [], "d": None, "inputs": [], "outputs": []}
    for key, name in _KEYS.items():
        if (value := values.get(key, values.get(name))) is not None:
            system[name] = _numbers(value, key, f"{source}: file: {path}")
    if system["d"] is None and not np.size(system["b"]):
        raise BadInput(f"{source}: file: {path}: holds no A, B, C, D")
    if "period" not in system and "dt" in values:
        raise BadInput(
            f"{source}: file: {path}: holds dt and no Ts: call the period Ts [s], 0 if continuous"
        )
    given = {name: value for name in "abcd" if (value := system[name]) is not None}
    rows = {name: np.atleast_2d(value).tolist() for name, value in given.items()}
    system |= {name: [] if not np.size(value) else value for name, value in rows.items()}
    system["period"] = float(np.ravel(system.get("period", 0.0))[0])
    if system["period"] < 0.0:
        raise BadInput(f"{source}: file: {path}: Ts: is unspecified; give seconds, or 0")
    for name in _NAMES:
        if name in values:
            system[name] = [str(entry).strip() for entry in np.ravel(np.asarray(values[name]))]
    return {"system": system}


def _read(path: Path) -> dict[str, Any]:
    content = given_bytes(path)
    if path.suffix == ".mat":
        return read_mat(path, (*_KEYS, *_KEYS.values(), "dt"), _NAMES)
    if path.suffix == ".npz":
        return dict(read_npz(BytesIO(content)))
    values = load_yaml(given_text(path), str(path))
    if not isinstance(values, dict):
        raise ValueError("it holds no keys")
    return values


def _numbers(value: Any, key: str, place: str) -> Any:
    try:
        if np.iscomplexobj(value):  # else the imaginary part would be dropped
            raise ValueError
        return np.asarray(value, dtype=np.float64).tolist()
    except (TypeError, ValueError):
        raise BadInput(f"{place}: {key}: holds no real numbers in equal rows") from None
