"""Laws and plans that a notebook gives as objects, under names that a trial can hold.

A trial is text. An object that no file holds stands in a module of its own in this process, and
the trial names it there: `flexslew_given.MyLaw`. Its log can be read anywhere, but flown again only
where the object is; a class of an importable module keeps its own name.
"""

import importlib
import inspect
import sys
from collections.abc import Callable, Hashable
from copy import deepcopy
from dataclasses import replace
from types import ModuleType
from typing import Any, ClassVar, TypeAlias

import numpy as np

from flexslew_control.analysis.save_law import law_of_system
from flexslew_control.controllers import LINEAR
from flexslew_control.plan import Plan
from flexslew_control.plans.plan_file import plan_hash
from flexslew_lab.trial.sources import with_method
from flexslew_lab.trial.trial import Trial, law_of
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import Trust
from flexslew_plant.settings import section
from flexslew_plant.testbeds.orientation.attitude import AttitudeJoints

MODULE = "flexslew_given"
_CLASSES: dict[Hashable, type[Any]] = {}  # by function (each keeps its own alive), or content
# a name, a class, a function; a system of python-control can be called, too
Given: TypeAlias = str | type[Any] | Callable[..., Any]


def with_law(values: dict[str, Any], law: Given) -> dict[str, Any]:
    """Return the keys of a trial that this law flies; the trial's other laws stay in it.

    Args:
        values: keys of a trial.
        law: a class with `update`, a function of (measurement, reference), a system of
            python-control, which controller `linear` flies, or a name: of a controller of the
            trial, which keeps its settings, or of a law with its defaults.

    Raises:
        BadInput: it is none of them.
    """
    others = values.get("controllers") or {}
    if isinstance(law, str) and law in others:
        return {**values, "active": law}
    if isinstance(law, str):
        name, settings = law.rpartition(":")[2].rpartition(".")[2], {"law": law}
    elif isinstance(law, type):
        if not callable(getattr(law, "update", None)):
            words = "a class with update(measurement, estimate, reference) is needed"
            raise BadInput(f"law: {law.__name__} is not allowed: {words}")
        name, settings = law.__name__, {"law": _named(law)}
    elif is_system(law):
        name, settings = LINEAR.name, _linear(others.get(LINEAR.name) or {}, law)
    elif callable(law):
        _require_two_arguments(law)
        definition = _stored_class(id(law), lambda: _class_of(law))
        name, settings = definition.__name__, {"law": _named(definition)}
    else:
        words = "give a class, a function, a system of python-control or a name"
        raise BadInput(f"law: a {type(law).__name__} is not allowed: {words}")
    name = name if name.isidentifier() else "mine"
    return {**values, "controllers": {**others, name: settings}, "active": name}


def _stored_class(key: Hashable, make: Callable[[], type[Any]]) -> type[Any]:
    """Return the class of an object, the same one for the same object; it lives on in MODULE."""
    found = _CLASSES.get(key)
    return found if found is not None else _CLASSES.setdefault(key, make())


def is_system(given: Any) -> bool:
    """Return whether an object is one of python-control; all of them can be called."""
    return any(kind.__module__.partition(".")[0] == "control" for kind in type(given).__mro__)


def _linear(before: dict[str, Any], system: Any) -> dict[str, Any]:
    """Return the settings of controller `linear` that flies a system; its others stay."""
    definition = {} if law_of(LINEAR.name, before)[0] != LINEAR.name else before
    kept = {key: value for key, value in definition.items() if key not in ("file", "system")}
    return {**kept, "system": law_of_system(system, "law")}


def _require_two_arguments(function: Callable[..., Any]) -> None:
    """Check the arguments of a law; a function without a signature is checked in flight.

    Raises:
        BadInput: if it does not take measurement and reference.
    """
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):
        return
    try:
        signature.bind(None, None)
    except TypeError as error:
        name = getattr(function, "__name__", type(function).__name__)
        raise BadInput(
            f"law: {name}{signature}: is asked (measurement, reference): {error}"
        ) from None


def with_plan(
    values: dict[str, Any], plan: Given | Plan | Matrix, source: str, trust: Trust
) -> dict[str, Any]:
    """Return the keys of a trial that flies this plan.

    Args:
        values: keys of a trial.
        plan: positions at every tick, shape (ticks + 1, joints) [rad or m], a Plan, a planner
            class, or the name of a method, which takes over the manoeuvre as other_method does.
        source: of the trial, for an error.
        trust: which planners it may name.

    Raises:
        BadInput: an array of another shape, or with numbers that are not finite; or no such method.
    """
    before = values.get("plan") or {}
    if isinstance(plan, str):
        return with_method(values, plan, source, trust)
    if isinstance(plan, type):
        return {**values, "plan": {**before, "method": _named(plan)}}
    if isinstance(plan, Plan):
        definition = _stored_class(plan_hash(plan), lambda: _planner_of(deepcopy(plan)))
        start = {"start": plan.start}
    else:
        rows = _positions(plan)
        definition, start = (
            _stored_class((rows.shape, rows.tobytes()), lambda: _planner_of(rows)),
            {},
        )
    return {**values, "plan": {"method": _named(definition), **start}}


def require_in_files(trial: Trial) -> None:
    """Check that other processes can fly a trial, to which the objects of this one are unknown.

    Raises:
        BadInput: it names one.
    """
    laws = [str((definition or {}).get("law", "")) for definition in trial.controllers.values()]
    for name in (*laws, str(getattr(trial.plan, "method", ""))):
        if name.startswith(f"{MODULE}."):
            words = f"{name.removeprefix(f'{MODULE}.')} is an object of this process"
            raise BadInput(f"{words}: other processes need it in a file, as my_law.py:MyLaw")


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
    """Return a law with the efforts that a function of (measurement, reference) returns.

    What a function remembers is the same for all flights, so that only the user's own flight calls
    it, and no planner that predicts the residual of a law.
    """

    def begin(self: Any, settings: dict[str, Any], period: float, effort_limit: Vector) -> None:
        """Take nothing: a function has no settings."""

    def update(self: Any, measurement: Any, estimate: Any, reference: Any) -> Vector:
        """Return what the function returns."""
        return np.asarray(function(measurement, reference))

    name = getattr(function, "__name__", "")
    members = {"__init__": begin, "update": update, "flight_only": True}
    return type(name if name.isidentifier() else "given", (), members)


def _planner_of(given: Plan | Matrix) -> type[Any]:
    """Return a planner with a plan, or positions at every tick, that is already made."""

    class GivenPlan:
        """Its keys in the `plan` section."""

        method: str
        start: float = 0.0  # [s]
        goal: dict[str, float] | None = None  # given by the last row
        is_made: ClassVar[bool] = True  # no slew is requested

        def plan(self, slew: Any, progress: Any) -> Plan:
            """Return the plan that was given, on the ticks of this bench."""
            names, period = slew.model.joint_names, slew.period
            if isinstance(given, Plan):
                _require_fit(given, names, period)
                return replace(given, method=self.method, start=self.start)
            ticks, joints = len(given) - 1, len(names)
            if given.shape[1] != joints:
                words = f"({ticks + 1}, {joints}): {', '.join(names)}"
                raise BadInput(f"plan: an array of shape {given.shape} does not fit: {words}")
            rates = _rates(given, period, slew.model.attitude)
            efforts, none, duration = (
                np.zeros((ticks, joints)),
                np.zeros((ticks + 1, 0)),
                ticks * period,
            )
            position = given.copy()
            return Plan(
                self.method, names, self.start, period, position, rates, efforts, none, duration
            )

    return section(GivenPlan)


def _rates(positions: Matrix, period: float, attitude: AttitudeJoints | None) -> Matrix:
    """Return joint rates by central differences, at rest before and after, same shape.

    Of joints that read an attitude these are body rates: the rotation from the tick before to the
    one after, as the rate of a rotation vector is none where the axis turns.

    Args:
        positions: at every tick, shape (ticks + 1, joints) [rad or m].
        period: one tick [s].
        attitude: of the joints that read one; None: none does.
    """
    rates = np.gradient(positions, period, axis=0)
    if attitude is not None:
        rates[1:-1] = attitude.error(positions[:-2], positions[2:]) / (2.0 * period)
    rates[[0, -1]] = 0.0
    return rates


def _require_fit(plan: Plan, names: tuple[str, ...], period: float) -> None:
    """Check a plan that was given against the bench that shall fly it.

    Raises:
        BadInput: it moves other joints, or in another order, has another period, or its parts are
            not of one size.
    """
    if plan.joint_names != names:
        words = f"moves {', '.join(plan.joint_names)}; this bench has {', '.join(names)}"
        raise BadInput(f"plan: {words}")
    if abs(plan.period - period) > 1e-9 * period:
        words = f"has a period of {plan.period:g} s; that of this trial is {period:g} s"
        raise BadInput(f"plan: {words}")
    rows, joints = plan.ticks + 1, len(names)
    sizes = {
        "position": (rows, joints),
        "velocity": (rows, joints),
        "effort": (rows - 1, joints),
        "state": (rows, *plan.state.shape[1:2]),
        "gains": (rows, *plan.gains.shape[1:2]) if plan.gains.size else plan.gains.shape,
    }
    for part, size in sizes.items():
        found = getattr(plan, part).shape
        if len(found) != 2 or found != size:
            words = f"{part} of shape {found} does not fit {plan.ticks} ticks of {joints} joints"
            raise BadInput(f"plan: {words}")
    if not 0.0 <= plan.duration <= (plan.ticks + 1e-6) * period:
        words = f"duration: {plan.duration:g} s is longer than its {plan.ticks} ticks"
        raise BadInput(f"plan: {words}")


def _named(object_class: type[Any]) -> str:
    """Return the name under which a class is found: its own, or one of the module of objects."""
    home = sys.modules.get(object_class.__module__)
    has_module = home is not None and home.__spec__ is not None and home.__name__ != MODULE
    if has_module and getattr(home, object_class.__name__, None) is object_class:
        return f"{object_class.__module__}.{object_class.__name__}"
    module = sys.modules.setdefault(MODULE, ModuleType(MODULE, "Objects given to a trial."))
    name, count = object_class.__name__, 1
    while (
        vars(module).setdefault(name, object_class) is not object_class
    ):  # at once: others may have threads
        count += 1
        name = f"{object_class.__name__}_{count}"
    assert importlib.import_module(MODULE) is module
    return f"{MODULE}.{name}"
