"""One trial over a grid of values: every number of its metrics as an array."""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product, repeat
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexslew_lab.metrics.rows import flat
from flexslew_lab.named import Named
from flexslew_lab.notebook import What, by_path, plain_data, trial
from flexslew_lab.progress import display_library_progress
from flexslew_lab.run.run_trial import RunFeedback, run_trial
from flexslew_lab.short_values import short
from flexslew_plant.arrays import Tensor
from flexslew_plant.errors import BadInput
from flexslew_plant.extras import required
from flexslew_plant.notebook_table import in_notebook

if TYPE_CHECKING:
    import pandas
    import xarray


@dataclass(frozen=True, repr=False)
class Sweep:
    """What came out at every point of a grid."""

    axes: dict[str, tuple[Any, ...]]  # the values by path of the trial, in the order of the axes
    metrics: dict[str, Tensor]  # by dotted name, one axis per path; NaN where there is no number

    def __getitem__(self, name: str) -> Tensor:
        """Return a metric over the grid.

        Raises:
            KeyError: if there is no such metric; the message lists all.
        """
        return Named(self.metrics, "metric")[name]

    def __repr__(self) -> str:
        """Return one line: the axes and how many metrics."""
        sizes = " x ".join(f"{path} ({len(values)})" for path, values in self.axes.items())
        return f"<Sweep {sizes}: {len(self.metrics)} metrics>"

    def _repr_html_(self) -> str:
        """Return the metrics that differ from point to point, for notebooks."""
        points = product(*map(_labels, self.axes.values()))
        variable = {
            name: values.ravel().tolist()
            for name, values in self.metrics.items()
            if name not in self.axes and (values.size == 1 or len(np.unique(values)) > 1)
        }
        numbers = zip(*variable.values(), strict=True) if variable else repeat(())
        rows = (
            [*map(short, point), *(short(value, 3) for value in row)]
            for point, row in zip(points, numbers, strict=False)
        )
        return in_notebook(repr(self), [*self.axes, *variable], rows)

    def frame(self) -> pandas.DataFrame:
        """Return a row per point, as a pandas DataFrame; lists and sections stand as text.

        Raises:
            ModuleNotFoundError: pandas is not installed.
        """
        pandas = required("pandas")
        points = None  # of a single flight
        if self.axes:
            labels = list(map(_labels, self.axes.values()))
            points = pandas.MultiIndex.from_product(labels, names=list(self.axes))
        return pandas.DataFrame({k: v.ravel() for k, v in self.metrics.items()}, index=points)

    def xarray(self) -> xarray.Dataset:
        """Return the metrics over named axes, as an xarray Dataset; lists and sections are text.

        A metric of the name of an axis, such as the duration, is that axis.

        Raises:
            ModuleNotFoundError: xarray is not installed.
        """
        xarray = required("xarray")
        dims = list(self.axes)
        data = {name: (dims, v) for name, v in self.metrics.items() if name not in dims}
        return xarray.Dataset(data, {path: _labels(values) for path, values in self.axes.items()})


def sweep(
    source: What = "m1",
    axes: Mapping[str, Sequence[Any] | np.ndarray[Any, Any]] | None = None,
    changes: Mapping[str, Any] | None = None,
    **given: Any,
) -> Sweep:
    """Return the metrics of a trial flown at every point of a grid, one after the other.

    Warnings of `fly` are warnings here, too, with the numbers of their points.

    Args:
        source: as for `trial`.
        axes: path to values, for example {"testbed.modes": [1, 2], "plan.duration": durations}.
        changes: path to value, the same at every point.
        given: law and plan, as for `trial`.

    Raises:
        BadInput: an axis has no values, or a point is not allowed; before anything is flown.
        PlanFailed: a point has no plan; the message names its number.
    """
    grid = {path: _values(path, values) for path, values in by_path(axes, "axes").items()}
    fixed = by_path(changes, "changes")
    _require_distinct(fixed, grid)
    points = [dict(zip(grid, values, strict=True)) for values in product(*grid.values())]
    trials = [trial(source, {**fixed, **point}, **given) for point in points]
    rows, warning_points = [], dict[str, list[int]]()
    with display_library_progress("sweep", "points", "flying") as count:
        for number, one in enumerate(trials):
            count(number, len(trials))
            with tempfile.TemporaryDirectory() as temporary:
                folder = Path(temporary, "run")
                messages: list[str] = []
                source = f"sweep point {number}"
                found = run_trial(
                    one,
                    source,
                    folder,
                    in_process=True,
                    report=False,
                    feedback=RunFeedback(warn=messages.append),
                )
                rows.append(_numbers(found.metrics))
                for words in messages:
                    warning_points.setdefault(words, []).append(number)
    for words, numbers in warning_points.items():
        more = f" and {len(numbers) - 1} more" if len(numbers) > 1 else ""
        warnings.warn(f"sweep point {numbers[0]}{more}: {words}", stacklevel=2)
    shape = tuple(map(len, grid.values()))
    names = dict.fromkeys(name for row in rows for name in row)
    return Sweep(
        grid,
        {name: np.array([row.get(name, np.nan) for row in rows]).reshape(shape) for name in names},
    )


def _require_distinct(changes: Iterable[str], axes: Iterable[str]) -> None:
    """Refuse an axis with a section that replaces a setting of a change or an earlier axis.

    Raises:
        BadInput: if it names both.
    """
    before = list(changes)
    for path in axes:
        for other in before:
            if other.startswith(f"{path}."):
                raise BadInput(f"{path} would replace {other}: give {other} as an axis behind it")
        before.append(path)


def _values(path: str, given: Any) -> tuple[Any, ...]:
    """Return the values of an axis as plain data.

    Raises:
        BadInput: there are none, or it is a single one.
    """
    single = isinstance(given, str | Mapping) or not isinstance(given, Iterable)
    if single or getattr(given, "ndim", 1) == 0:
        raise BadInput(f"{path}: {given!r} is not allowed: give a list of values")
    values = tuple(plain_data(value) for value in given)
    if not values:
        raise BadInput(f"{path} has no values")
    return values


def _labels(values: Sequence[Any]) -> list[Any]:
    """Return what an axis is labelled with: the values, as text where one of them is no scalar."""
    all_scalar = all(value is None or isinstance(value, str | int | float) for value in values)
    return list(values) if all_scalar else list(map(str, values))


def _numbers(metrics: Mapping[str, Any]) -> dict[str, float]:
    """Return what of the metrics is a number; NaN where there is none."""
    return {
        name: np.nan if value is None else float(value)
        for name, value in flat(metrics).items()
        if value is None or isinstance(value, int | float)
    }
