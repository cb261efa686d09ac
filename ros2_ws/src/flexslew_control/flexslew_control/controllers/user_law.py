"""Laws of the user's own: a class from a file, a module or an installed package, made safe.

The class needs `__init__(settings, period, effort_limit)` and
`update(measurement, estimate, reference) -> efforts`. It may have `reset(measurement, estimate,
reference, effort)`, an `estimator` (see law.Estimator), `terms`, and `follows_reference = False`
where it only holds the testbed at rest: then it is not ready under a plan that moves.

A class with `Settings`, a section as built-in laws have (flexslew_plant.settings.section), is built
as they are, with `__init__(settings, plant)`: validated settings and the plant's description.
"""

from contextlib import suppress
from time import perf_counter
from typing import Any

import numpy as np

from flexslew_control.controllers.probing.at_rest import plan_motion_error
from flexslew_control.law import (
    Estimate,
    Estimator,
    LawFailed,
    MeasuredJoints,
    PlantDescription,
    Reference,
    WrongShape,
)
from flexslew_control.plan import Plan
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.events import EVENTS, Fact
from flexslew_plant.measurement import Measurement
from flexslew_plant.own_code import LAWS, Trust, find_class, one_line
from flexslew_plant.settings import Positive, validated
from flexslew_plant.testbeds import initial_positions


def find_law(law: str, source: str, known: tuple[str, ...], trust: Trust) -> type[Any]:
    """Return the class that a name stands for; see own_code.find_class.

    Raises:
        BadInput: there is no such law, its module cannot be imported, or it is not trusted.
    """
    return find_class(law, LAWS, "law", source, known, trust)


def build_user_law(
    found: type[Any],
    law: str,
    values: dict[str, Any],
    plant: PlantDescription,
    source: str,
) -> tuple["UserEstimator", "UserLaw"]:
    """Return the estimator and the law of a user's class.

    Args:
        found: the class.
        law: what it was found by.
        values: its settings as they stand in the trial; `time_limit` [wall s] is taken out.
        plant: what it is for.
        source: file or node to name in an error.

    Raises:
        BadInput: a setting is not allowed, the class cannot be built, or has no `update`.
    """
    options = dict(values)
    limit = validated(Positive | None, options.pop("time_limit", None), f"{source}: time_limit")
    try:
        if (section := getattr(found, "Settings", None)) is None:
            built = found(options, plant.period, plant.effort_limit.copy())
        else:
            built = found(validated(section, options, source), plant)
    except BadInput:
        raise
    except Exception as error:
        raise BadInput(f"{law} cannot be built: {one_line(error)}", source) from error
    if not callable(getattr(built, "update", None)):
        raise BadInput(f"{law} has no method update(measurement, estimate, reference)", source)
    estimator = getattr(built, "estimator", None)
    initial = initial_positions(plant.testbed)
    rest = np.array([initial[name] for name in plant.joint_names])
    return (
        UserEstimator(estimator if estimator is not None else MeasuredJoints(), law),
        UserLaw(built, law, plant.effort_limit.size, limit, rest),
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
            raise LawFailed(f"the estimator of {self._law} raised {one_line(error)}") from error

    def update(self, measurement: Measurement) -> Estimate:
        """Return the user's estimate.

        Raises:
            LawFailed: the user's code raised, or gave no Estimate.
        """
        try:
            estimate = self._estimator.update(measurement)
        except Exception as error:
            raise LawFailed(f"the estimator of {self._law} raised {one_line(error)}") from error
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
        rest: where the joints rest at the start, shape (joints,); None: it follows any plan.
    """

    def __init__(
        self,
        built: Any,
        law: str,
        joints: int,
        time_limit: float | None,
        rest: Vector | None = None,
    ) -> None:
        self._built, self._law, self._joints = built, law, joints
        self._rest = None if getattr(built, "follows_reference", True) else rest
        # a planner must not call it for its prediction: it may keep a state of earlier calls
        self.flight_only: bool = getattr(built, "flight_only", False)
        self._limit = time_limit
        self.terms: dict[str, Vector] = {}

    @property
    def remarks(self) -> list[Fact]:
        """Events of the last update, which the user's law lists in `remarks`."""
        given = getattr(self._built, "remarks", ())
        if not given or not isinstance(given, list | tuple):
            return []
        kinds = set(EVENTS.values())
        return [what for what in given if type(what) in kinds]

    def close(self) -> None:
        """Call the user's `close`, if there is one; what it raises changes nothing of the run."""
        with suppress(Exception):
            getattr(self._built, "close", lambda: None)()

    def objection(self, plan: Plan | None) -> str:
        """Return why it cannot fly this plan; empty if it can."""
        return "" if self._rest is None else plan_motion_error(plan, self._rest)

    def reset(
        self, measurement: Measurement, estimate: Estimate, reference: Reference, effort: Vector
    ) -> None:
        """Call the user's `reset`, if there is one, since the law becomes active.

        Raises:
            LawFailed: if the user's code raised.
        """
        reset = getattr(self._built, "reset", None)
        if reset is None:
            return
        try:
            reset(measurement, estimate, reference, effort.copy())
        except Exception as error:
            raise LawFailed(f"{self._law} raised {one_line(error)} in reset") from error

    def update(self, measurement: Measurement, estimate: Estimate, reference: Reference) -> Vector:
        """Return the user's efforts, checked, shape (joints,) [N m or N].

        Raises:
            LawFailed: the user's code raised, took too long, or gave no such efforts.
        """
        started = perf_counter()
        try:
            answer = self._built.update(measurement, estimate, reference)
            if np.iscomplexobj(answer):
                raise TypeError(f"{answer} is complex")
            if np.ma.is_masked(answer):
                raise TypeError(f"{answer} is masked")
            effort = np.array(answer, dtype=np.float64)
            terms = self._terms()
        except Exception as error:
            raise LawFailed(f"{self._law} raised {one_line(error)}") from error
        elapsed = perf_counter() - started
        if self._limit is not None and elapsed > self._limit:
            raise LawFailed(
                f"{self._law} took {elapsed * 1e3:.3g} ms, time_limit is {self._limit * 1e3:.3g} ms"
            )
        if effort.shape != (self._joints,):
            raise WrongShape(
                f"{self._law} gave efforts of shape {effort.shape}, expected ({self._joints},)"
            )
        if not np.isfinite(effort).all() and _all_finite(measurement):
            raise LawFailed(f"{self._law} gave {effort.tolist()}, which is not finite")
        self.terms = terms
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


def _all_finite(measurement: Measurement) -> bool:
    """Return whether every sensor reads a number; what comes of one that does not is no fault."""
    measured = (
        measurement.joint_position,
        measurement.joint_velocity,
        measurement.tip_deflection,
        measurement.root_curvature,
    )
    return all(bool(np.isfinite(reading).all()) for reading in measured)
