"""Laws of the user's own: a class from a file, a module or an installed package, made safe.

The class needs `__init__(settings, period, effort_limit)` and
`update(measurement, estimate, reference) -> efforts`. It may have `reset(measurement, estimate,
reference, effort)`, an `estimator` (see law.Estimator) and `terms`.
"""

import importlib
import importlib.util
import traceback
from importlib.metadata import entry_points
from pathlib import Path
from time import perf_counter
from types import ModuleType
from typing import Any

import numpy as np

from flexslew_control.law import Estimate, Estimator, LawFailed, MeasuredJoints, Reference
from flexslew_plant.arrays import Vector
from flexslew_plant.bench.measurement import Measurement
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import Positive, validated

GROUP = "flexslew.laws"  # of the entry points of installed packages


def find_law(law: str, source: str, known: tuple[str, ...] = ()) -> type[Any]:
    """Return the class that a name stands for.

    Args:
        law: `my_law.py:MyLaw` (a path from the working directory), `package.module.MyLaw`, or
            the name of an entry point of the group flexslew.laws.
        source: file or node to name in an error.
        known: the laws that are built in, for the error.

    Raises:
        BadInput: there is no such law, or its module cannot be imported.
    """
    for point in entry_points(group=GROUP):
        if point.name == law:
            return _class_of(point.load, law, source)
    if ".py:" in law:
        path, _, name = law.rpartition(":")
        return _class_of(lambda: getattr(_module_at(Path(path)), name), law, source)
    if "." in law:
        place, _, name = law.rpartition(".")
        return _class_of(lambda: getattr(importlib.import_module(place), name), law, source)
    allowed = ", ".join(sorted({*known, *(point.name for point in entry_points(group=GROUP))}))
    raise BadInput(
        f"{source}: {law} is not a law; allowed: {allowed}, my_law.py:MyLaw, package.module.MyLaw"
    )


def build_user_law(
    found: type[Any],
    law: str,
    values: dict[str, Any],
    period: float,
    effort_limit: Vector,
    source: str,
) -> tuple["UserEstimator", "UserLaw"]:
    """Return the estimator and the law of a user's class.

    Args:
        found: the class.
        law: what it was found by.
        values: its settings as they stand in the trial; `time_limit` [wall s] is taken out.
        period: one tick [s].
        effort_limit: of the drives, shape (joints,) [N m or N].
        source: file or node to name in an error.

    Raises:
        BadInput: the class cannot be built, or has no `update`.
    """
    own = dict(values)
    limit = validated(Positive | None, own.pop("time_limit", None), f"{source}: time_limit")
    try:
        built = found(own, period, effort_limit.copy())
    except Exception as error:
        raise BadInput(f"{source}: {law} cannot be built: {_words(error)}") from error
    if not callable(getattr(built, "update", None)):
        raise BadInput(f"{source}: {law} has no method update(measurement, estimate, reference)")
    estimator = getattr(built, "estimator", None)
    return (
        UserEstimator(estimator if estimator is not None else MeasuredJoints(), law),
        UserLaw(built, law, effort_limit.size, limit),
    )


class UserEstimator:
    """A user's estimator; what it raises is a LawFailed that names it."""

    def __init__(self, estimator: Estimator, law: str) -> None:
        self._estimator, self._law = estimator, law

    def reset(self, measurement: Measurement) -> None:
        """Start from this measurement.

        Raises:
            LawFailed: the user's code raised.
        """
        try:
            self._estimator.reset(measurement)
        except Exception as error:
            raise LawFailed(f"the estimator of {self._law} raised {_words(error)}") from error

    def update(self, measurement: Measurement) -> Estimate:
        """Return the user's estimate.

        Raises:
            LawFailed: the user's code raised, or gave no Estimate.
        """
        try:
            estimate = self._estimator.update(measurement)
        except Exception as error:
            raise LawFailed(f"the estimator of {self._law} raised {_words(error)}") from error
        if not isinstance(estimate, Estimate):
            raise LawFailed(f"the estimator of {self._law} gave a {type(estimate).__name__}")
        try:
            position = np.array(estimate.position, dtype=np.float64)
            velocity = np.array(estimate.velocity, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise LawFailed(f"the estimator of {self._law} gave no numbers: {error}") from error
        return estimate._replace(position=position, velocity=velocity)


class UserLaw:
    """A user's law behind the contract of law.Law.

    Args:
        built: an instance of the user's class.
        law: what it was found by.
        joints: how many efforts it must give.
        time_limit: of one update [wall s]; None: none, which keeps a run the same everywhere.
    """

    def __init__(self, built: Any, law: str, joints: int, time_limit: float | None) -> None:
        self._built, self._law, self._joints = built, law, joints
        self._limit = time_limit
        self.terms: dict[str, Vector] = {}

    def reset(
        self, measurement: Measurement, estimate: Estimate, reference: Reference, effort: Vector
    ) -> None:
        """Tell the user's law that it takes charge, if it wants to know.

        Raises:
            LawFailed: the user's code raised.
        """
        reset = getattr(self._built, "reset", None)
        if reset is None:
            return
        try:
            reset(measurement, estimate, reference, effort.copy())
        except Exception as error:
            raise LawFailed(f"{self._law} raised {_words(error)} in reset") from error

    def update(self, measurement: Measurement, estimate: Estimate, reference: Reference) -> Vector:
        """Return the user's efforts, checked, shape (joints,) [N m or N].

        Raises:
            LawFailed: the user's code raised, took too long, or gave no such efforts.
        """
        begun = perf_counter()
        try:
            answer = self._built.update(measurement, estimate, reference)
            effort = np.array(answer, dtype=np.float64)
        except Exception as error:
            raise LawFailed(f"{self._law} raised {_words(error)}") from error
        took = perf_counter() - begun
        if self._limit is not None and took > self._limit:
            raise LawFailed(
                f"{self._law} took {took * 1e3:.3g} ms, time_limit is {self._limit * 1e3:.3g} ms"
            )
        if effort.shape != (self._joints,):
            raise LawFailed(
                f"{self._law} gave efforts of shape {effort.shape}, wanted ({self._joints},)"
            )
        if not np.isfinite(effort).all() and _whole(measurement):
            raise LawFailed(f"{self._law} gave {effort.tolist()}, which is not finite")
        self.terms = self._terms()
        return effort

    def _terms(self) -> dict[str, Vector]:
        """Return the summands that the user's law names; those of another shape are left out."""
        given = getattr(self._built, "terms", None)
        if not isinstance(given, dict):
            return {}
        terms = {}
        for name, value in given.items():
            try:
                term = np.array(value, dtype=np.float64)
            except (TypeError, ValueError):
                continue
            if term.shape == (self._joints,):
                terms[str(name)] = term
        return terms


def _module_at(path: Path) -> ModuleType:
    """Return the module of a file, under a name that hides no other."""
    spec = importlib.util.spec_from_file_location(f"flexslew_user_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path} is not a Python file")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _class_of(load: Any, law: str, source: str) -> type[Any]:
    try:
        found = load()
    except Exception as error:  # a user's module may do anything
        raise BadInput(f"{source}: {law} cannot be loaded: {_words(error)}") from error
    if not isinstance(found, type):
        raise BadInput(f"{source}: {law} is a {type(found).__name__}, wanted is a class")
    return found


def _whole(measurement: Measurement) -> bool:
    """Return whether every sensor reads a number; what comes of one that does not is no fault."""
    readings = (
        measurement.joint_position,
        measurement.joint_velocity,
        measurement.tip_deflection,
        measurement.root_curvature,
    )
    return all(bool(np.isfinite(reading).all()) for reading in readings)


def _words(error: Exception) -> str:
    """Return an exception in one line, with the place in the user's file where it was raised."""
    text = " ".join(str(error).split())
    words = f"{type(error).__name__}: {text}" if text else type(error).__name__
    if isinstance(error, SyntaxError):  # its own words name the place
        return words
    frames = [f for f in traceback.extract_tb(error.__traceback__) if not _ours(f.filename)]
    if not frames:
        return words
    place = next(f for f in reversed(frames) if f.filename == frames[0].filename)
    path = Path(place.filename)
    shown = path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path
    return f"{words} ({shown}, line {place.lineno})"


def _ours(filename: str) -> bool:
    """Return whether a frame is of this file or of the machinery that imports modules."""
    return filename == __file__ or filename.startswith("<frozen") or "importlib" in filename
