"""Universal files (.uff, .unv) of modal tests: functions at nodes (58) and data at nodes (55)."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexslew_lab.identification.files.columns import Columns, FileClock
from flexslew_plant.errors import BadInput
from flexslew_plant.extras import required
from flexslew_plant.given_file import LARGEST, open_given
from flexslew_plant.near_names import spelling_hint

FUNCTION, DATA_AT_NODES, COORDINATES = 58, 55, (15, 2411)  # types of datasets
TIME_RESPONSE, FREQUENCY_RESPONSE = 1, 4  # types of functions
_DIRECTIONS = ("", "X", "Y", "Z", "RX", "RY", "RZ")

Dataset = dict[str, Any]


def read_datasets(path: Path, kind: int) -> list[Dataset]:
    """Return the datasets of one type of a universal file, as pyuff gives them.

    Raises:
        BadInput: see datasets_by_type; or if there are none.
    """
    if not (found := datasets_by_type(path, (kind,))):
        raise BadInput(f"holds no dataset {kind}; its datasets are: {_listed(path)}", path)
    return found


def datasets_by_type(path: Path, kinds: tuple[int, ...]) -> list[Dataset]:
    """Return the datasets of some types, in the order of the file.

    Raises:
        BadInput: if it is damaged or too large.
        ModuleNotFoundError: if pyuff is missing.
    """
    pyuff: Any = required("pyuff")
    open_given(path, LARGEST).close()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            file = pyuff.UFF(str(path))
            types = [int(one) for one in file.get_set_types()]
            return [file.read_sets(k) for k, one in enumerate(types) if one in kinds]
    except Exception as error:  # damaged text meets a parser with errors of many kinds
        raise BadInput(f"cannot be read: {error or type(error).__name__}", path) from None


def _listed(path: Path) -> str:
    pyuff: Any = required("pyuff")
    types = {int(one) for one in pyuff.UFF(str(path)).get_set_types()}
    return ", ".join(map(str, sorted(types))) or "none"


def read_uff(path: Path, names: list[str], clock: FileClock) -> Columns:
    """Return time responses of a universal file by name; each has its own times [s].

    A name is the first line of a dataset, or its node with direction, as `12+Z` or `12+RZ`.

    Raises:
        BadInput: if it cannot be read, or a name is missing or stands for several functions.
    """
    if clock.unit is not None or clock.column is not None or clock.recorded:
        raise BadInput("its times are in seconds, in each dataset; leave out --time, --time-unit "
                       "and --stamps", path)  # fmt: skip
    functions = [one for one in read_datasets(path, FUNCTION) if integer(path, one, "func_type")
                 == TIME_RESPONSE]  # fmt: skip
    by_name: dict[str, list[Dataset]] = {}
    for one in functions:
        place = degree_of_freedom(path, one, "rsp")
        for name in dict.fromkeys((str(one.get("id1", "")).strip(), place)):
            by_name.setdefault(name, []).append(one)
    series = {}
    for name in names:
        found = by_name.get(name, [])
        if len(found) != 1:
            known = "; ".join(by_name) or "none"
            hint = "" if found else spelling_hint(name, list(by_name))
            why = f"{len(found)} time responses are called {name}"
            raise BadInput(f"{why}; {hint}time responses are: {known:.1000}", path)
        series[name] = abscissa(path, found[0]), real_values(path, found[0])
    return Columns(series, str(path))


def abscissa(path: Path, one: Dataset) -> Any:
    """Return times [s] or frequencies [Hz] of a function, increasing numbers."""
    (x,) = numbers(path, one, "x")
    data = np.asarray(one.get("data", ()))
    if x.shape != data.shape or x.size < 2 or data.dtype.kind not in "fc":
        raise BadInput(f"a function has {data.size} values at {x.size} places", path)
    return np.asarray(x)


def real_values(path: Path, one: Dataset) -> Any:
    """Return the values of a function of time, real."""
    data = np.asarray(one["data"])
    if data.dtype.kind == "c":
        if data.imag.any():
            raise BadInput("a time response is complex", path)
        data = data.real
    return np.asarray(data, dtype=np.float64)


def degree_of_freedom(path: Path, one: Dataset, side: str) -> str:
    """Return node and direction of a response (`rsp`) or a reference (`ref`), as `12+Z`."""
    node, code = (integer(path, one, f"{side}_{what}") for what in ("node", "dir"))
    if abs(code) >= len(_DIRECTIONS):
        raise BadInput(f"direction {code} of node {node} is unknown; allowed are -6 to 6", path)
    return f"{node}{'' if code == 0 else '-' if code < 0 else '+'}{_DIRECTIONS[abs(code)]}"


def numbers(path: Path, one: Dataset, *keys: str) -> NDArray[Any]:
    """Return finite numbers of a dataset, shape (keys, entries); of each key as many.

    Raises:
        BadInput: if one is missing, or they are no numbers or not as many.
    """
    try:
        found = np.array([np.atleast_1d(np.real(one[key])) for key in keys], dtype=np.float64)
    except (KeyError, TypeError, ValueError):
        found = np.zeros(0)
    if found.ndim != 2 or not np.isfinite(found).all():
        raise BadInput(f"a dataset has not as many finite numbers of each of {', '.join(keys)}",
                       path)  # fmt: skip
    return found


def integer(path: Path, one: Dataset, key: str) -> int:
    """Return a whole number of a dataset.

    Raises:
        BadInput: if it is missing.
    """
    try:
        return int(one[key])
    except (KeyError, TypeError, ValueError, OverflowError):
        raise BadInput(f"a dataset has no {key}", path) from None
