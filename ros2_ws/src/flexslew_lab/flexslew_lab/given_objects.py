"""Laws and plans that a notebook gives as objects, under names that a trial can hold.

A trial is text. An object that no file holds stands in a module of its own in this process, and
the trial names it there: `flexslew_given.MyLaw`. Its log can be read anywhere, but flown again only
where the object is; a class of an importable module keeps its own name.
"""

import importlib
import sys
from collections.abc import Callable
from types import ModuleType
from typing import Any, TypeAlias

import numpy as np

from flexslew_control.plan import Plan
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import section

MODULE = "flexslew_given"
Given: TypeAlias = str | type[Any] | Callable[..., Any]


def with_law(values: dict[str, Any], law: Given) -> dict[str, Any]:
    """Return the keys of a trial that this law flies; the trial's other laws stay beside it.

    Args:
        values: keys of a trial.
        law: a class with `update`, a function of (measurement, reference), or a name.

    Raises:
        BadInput: it is neither.
    """
    if isinstance(law, str):
        name, settings = law.rpartition(":")[2].rpartition(".")[2], {"law": law}
    elif isinstance(law, type):
        if not callable(getattr(law, "update", None)):
            words = "a class with update(measurement, estimate, reference) is needed"
            raise BadInput(f"law: {law.__name__} is not allowed: {words}")
        name, settings = law.__name__, {"law": _named(law)}
    elif callable(law):
        own = _class_of(law)
        name, settings = own.__name__, {"law": _named(own)}
    else:
        raise BadInput(f"law: a {type(law).__name__} is not allowed: give a class or a function")
    others = values.get("controllers") or {}
    name = name if name.isidentifier() else "mine"
    return {**values, "controllers": {**others, name: settings}, "active": name}


def with_plan(values: dict[str, Any], plan: Given | Plan | Matrix) -> dict[str, Any]:
    """Return the keys of a trial that flies this plan.

    Args:
        values: keys of a trial.
        plan: positions at every tick, shape (ticks + 1, joints) [rad or m], a Plan, a planner
            class, or a name.

    Raises:
        BadInput: an array of another shape, or with numbers that are not finite.
    """
    before = values.get("plan") or {}
    if isinstance(plan, str):
        return {**values, "plan": {**before, "method": plan}}
    if isinstance(plan, type):
        return {**values, "plan": {**before, "method": _named(plan)}}
    if isinstance(plan, Plan):
        own = _planner_of(plan.position, plan.velocity, plan.effort)
        start = {"start": plan.start}
    else:
        own, start = _planner_of(_positions(plan)), {}
    return {**values, "plan": {"method": _named(own), **start}}


def _positions(plan: Any) -> Matrix:
    """Return positions at every tick, checked."""
    if np.ma.is_masked(plan):
        raise BadInput("plan: some of its numbers are masked")
    rows = np.asarray(plan)
    if rows.dtype.kind not in "biufO":
        raise BadInput(f"plan: an array of {rows.dtype} is not allowed: give real numbers")
    try:
        rows = rows.astype(np.float64)
    except (TypeError, ValueError) as error:
        raise BadInput(f"plan: {error}: give real numbers") from None
    if rows.ndim != 2 or len(rows) < 2:
        words = "(ticks + 1, joints), at least two rows"
        raise BadInput(f"plan: an array of shape {rows.shape} is not allowed: {words}")
    if not np.isfinite(rows).all():
        raise BadInput("plan: some of its numbers are not finite")
    return rows


def _class_of(function: Callable[..., Any]) -> type[Any]:
    """Return a law whose efforts a function of (measurement, reference) returns.

    What a function remembers is the same for all flights, so no other flight than the user's own
    asks it, as a planner does that foretells what a law leaves.
    """

    def begin(self: Any, settings: dict[str, Any], period: float, effort_limit: Vector) -> None:
        """Take nothing: a function has no settings."""

    def update(self: Any, measurement: Any, estimate: Any, reference: Any) -> Vector:
        """Return what the function returns."""
        return np.asarray(function(measurement, reference))

    name = getattr(function, "__name__", "")
    members = {"__init__": begin, "update": update, "flight_only": True}
    return type(name if name.isidentifier() else "given", (), members)


def _planner_of(
    position: Matrix, velocity: Matrix | None = None, effort: Matrix | None = None
) -> type[Any]:
    """Return a planner whose plan is already there."""

    class GivenPlan:
        """Its keys in the `plan` section."""

        method: str
        start: float = 0.0  # [s]
        goal: dict[str, float] | None = None  # told by the last row

        def plan(self, slew: Any, progress: Any) -> Plan:
            """Return the plan that was given, on the ticks of this bench."""
            model, ticks = slew.model, len(position) - 1
            if position.shape[1] != model.joints:
                words = f"({ticks + 1}, {model.joints}): {', '.join(model.joint_names)}"
                raise BadInput(f"plan: an array of shape {position.shape} does not fit: {words}")
            rates = velocity
            if rates is None:
                rates = np.gradient(position, slew.period, axis=0)
                rates[[0, -1]] = 0.0  # at rest before and after
            efforts = np.zeros((ticks, model.joints)) if effort is None else effort
            none, lasts = np.zeros((ticks + 1, 0)), ticks * slew.period
            return Plan(
                self.method, model.joint_names, self.start, slew.period, position.copy(),
                rates, efforts, none, lasts,
            )  # fmt: skip

    return section(GivenPlan)


def _named(thing: type[Any]) -> str:
    """Return the name under which a class is found: its own, or one of the module of objects."""
    home = sys.modules.get(thing.__module__)
    lasting = home is not None and home.__spec__ is not None and home.__name__ != MODULE
    if lasting and getattr(home, thing.__name__, None) is thing:
        return f"{thing.__module__}.{thing.__name__}"
    module = sys.modules.setdefault(MODULE, ModuleType(MODULE, "Objects given to a trial."))
    name, count = thing.__name__, 1
    while vars(module).setdefault(name, thing) is not thing:  # at once: others may have threads
        count += 1
        name = f"{thing.__name__}_{count}"
    assert importlib.import_module(MODULE) is module
    return f"{MODULE}.{name}"
