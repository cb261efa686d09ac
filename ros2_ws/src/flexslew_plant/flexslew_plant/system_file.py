"""A linear system from a file that python-control, MATLAB, NumPy or a person wrote."""

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from flexslew_plant.arrays import Matrix
from flexslew_plant.errors import BadInput
from flexslew_plant.given_file import given_bytes, given_text
from flexslew_plant.mat_file import read_mat
from flexslew_plant.near_names import spelling_hint
from flexslew_plant.npz_file import read_npz
from flexslew_plant.yaml_data import load_yaml

_KEYS = {"A": "a", "B": "b", "C": "c", "D": "d", "Ts": "period"}
_NAMES = ("inputs", "outputs")
_READ = (*_KEYS, *_NAMES)
_KNOWN = {*_READ, *_KEYS.values(), "states"}  # the names of states are not used
# errors by which readers report that a file is in another format, or damaged
_READ_ERRORS = (ValueError, TypeError)
_SUFFIXES = (".mat", ".npz", ".yaml", ".yml", ".json")


def system_from_file(path: str, source: str) -> dict[str, Any]:
    """Return the key `system` of a linear law or testbed as a file holds it, plain data.

    Args:
        path: .mat of MATLAB's version 5 to 7, .npz, .yaml or .json with A, B, C, D, Ts (0:
            continuous) and, if it has them, inputs and outputs.
        source: the file or node that names it, for an error.

    Raises:
        BadInput: it cannot be read, or holds no such system.
    """
    place = Path(path)
    if place.suffix not in _SUFFIXES:
        raise BadInput(f"{source}: file: {path}: give a file that ends in {', '.join(_SUFFIXES)}")
    try:
        values = _read(place)
    except BadInput as error:
        raise BadInput(f"{source}: file: {error}") from None
    except OSError as error:
        raise BadInput(f"{source}: file: {path}: cannot be read: {error.strerror}") from None
    except _READ_ERRORS as error:
        raise BadInput(f"{source}: file: {path}: cannot be read: {error}") from None
    return {"system": _system(values, f"{source}: file: {path}")}


def _system(values: dict[str, Any], place: str) -> dict[str, Any]:
    """Return the key `system` from the variables of a file.

    Raises:
        BadInput: if a name is unknown, or a value has another kind or shape.
    """
    _require_known(values, place)
    # every key, so that nothing is left of a system that this one replaces
    system: dict[str, Any] = {"a": [], "b": [], "c": [], "d": None, "inputs": [], "outputs": []}
    for key, name in _KEYS.items():
        if (value := values.get(key, values.get(name))) is not None:
            system[name] = _numbers(value, key, place)
    if system["d"] is None and not np.size(system["b"]):
        raise BadInput("holds no A, B, C, D", place)
    period = np.ravel(system.pop("period", 0.0))
    if period.size != 1 or period[0] < 0.0:
        words = "Ts: give one number of seconds, 0 if continuous; a negative one is unspecified"
        raise BadInput(words, place)
    for name in "abcd":
        if isinstance(system[name], np.ndarray):
            system[name] = system[name].tolist() if system[name].size else []
    system["period"] = float(period[0])
    for name in _NAMES:
        if name in values:
            system[name] = _text_list(values[name], name, place)
    return system


def _require_known(values: dict[str, Any], place: str) -> None:
    """Refuse a variable that would be ignored: a misspelt `Ts` makes a system continuous."""
    for name in map(str, values):
        if name == "dt":
            raise BadInput("dt: call the period Ts [s], 0 if continuous", place)
        if name not in _KNOWN:
            words = f"unknown key; {spelling_hint(name, _READ)}allowed: {', '.join(_READ)}"
            raise BadInput(words, place, name)
        if name in _KEYS and _KEYS[name] in values:
            raise BadInput(f"is not allowed beside {name}: both set the same value", place,
                           _KEYS[name])  # fmt: skip


def _text_list(value: Any, key: str, place: str) -> list[str]:
    """Return names of signals: a list of texts, or the cells of a .mat file."""
    try:
        names = np.ravel(np.asarray(value)).tolist()
    except ValueError:
        names = [None]
    if not all(isinstance(name, str) for name in names):
        raise BadInput("a list of names of signals", place, key, value)
    return [name.strip() for name in names]


def _read(path: Path) -> dict[str, Any]:
    content = given_bytes(path)
    if path.suffix == ".mat":
        return read_mat(path, (*_KEYS, *_KEYS.values()), _NAMES)
    if path.suffix == ".npz":
        return dict(read_npz(BytesIO(content)))
    values = load_yaml(given_text(path), str(path))
    if not isinstance(values, dict):
        raise ValueError("it holds no keys")
    return values


def _numbers(value: Any, key: str, place: str) -> Matrix:
    """Return rows of finite numbers."""
    try:
        if np.iscomplexobj(value):  # else the imaginary part would be dropped
            raise ValueError
        numbers = np.atleast_2d(np.asarray(value, dtype=np.float64))
    except (TypeError, ValueError):
        raise BadInput(f"{place}: {key}: holds no real numbers in equal rows") from None
    if numbers.ndim != 2 or not np.isfinite(numbers).all():
        raise BadInput(f"{place}: {key}: give finite numbers in equal rows")
    return numbers
