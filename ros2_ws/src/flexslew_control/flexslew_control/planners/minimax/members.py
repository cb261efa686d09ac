"""The models for which one feedforward shall do: an ensemble about what the planner believes."""

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import field, replace
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field

from flexslew_control.planners.slew import Slew
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import Trust
from flexslew_plant.settings import flat, plain, section
from flexslew_plant.testbeds import Model, Testbed, with_changes

Spread = tuple[float, float]
MOST = 400  # members
_SCALE_KEYS = ("stiffness", "payload")  # by name, see Testbed.scaled
_PREFIX = "testbed."  # as a study writes its keys


@section
class Ensemble:
    """What may differ from the model that the planner believes in, and which models stand for it.

    The model itself is always a member, the first one.
    """

    # lowest and highest relative error by name: `stiffness`, `payload`, or any number of the
    # testbed, as `parameters.free_mass` [-]
    vary: dict[str, Spread] = field(default_factory=lambda: {"stiffness": (-0.2, 0.2)})
    # which members: grid (every combination of levels), corners (of the ends) or sampled
    draw: Literal["grid", "corners", "sampled"] = "grid"
    # levels of each key of a grid, members of a sample; the planner's own model is always a member
    count: Annotated[int, Field(ge=1, le=MOST)] = 11
    seed: Annotated[int, Field(ge=0)] = 1  # of a sample


class Member(NamedTuple):
    """One model of an ensemble."""

    errors: dict[str, float]  # relative, by key [-]
    model: Model


def members_of(settings: Ensemble, slew: Slew) -> tuple[Member, ...]:
    """Return the members of an ensemble, the planner's own model first.

    Args:
        settings: the `ensemble` section.
        slew: the slew on the planner's own model.

    Raises:
        BadInput: if the testbed lacks a key or it is no number, a range contains no zero, or there
            are too many members.
    """
    keys = tuple(settings.vary)
    for key, (low, high) in settings.vary.items():
        if not -1.0 < low <= 0.0 <= high:
            why = "lowest and highest relative error, above -1 and about 0"
            raise BadInput(why, "plan", f"ensemble.vary.{key}", [low, high])
    points = _points(settings)
    if len(points) > MOST:
        raise BadInput(f"{len(points)} members, at most {MOST}", "plan", "ensemble", settings.count)
    nominal = Member(dict.fromkeys(keys, 0.0), slew.model)
    return nominal, *_at(points, keys, slew)


def intermediate_members(settings: Ensemble, slew: Slew, parts: int) -> tuple[Member, ...]:
    """Return the models between the levels of a grid; none where they are too many.

    What a plan leaves between its members is seen on them.

    Args:
        settings: the `ensemble` section.
        slew: the slew on the planner's own model.
        parts: number of parts from one level to the next.
    """
    levels = parts * (settings.count - 1) + 1
    if settings.draw != "grid" or settings.count < 2 or levels ** len(settings.vary) > MOST:
        return ()
    known = {tuple(point) for point in _points(settings).round(12).tolist()}
    refined = _points(replace(settings, count=levels))
    new = [point for point in refined if tuple(point.round(12).tolist()) not in known]
    return tuple(_at(new, tuple(settings.vary), slew))


def _at(points: Iterable[Vector], keys: tuple[str, ...], slew: Slew) -> Iterator[Member]:
    """Yield the members with relative errors, but for the one without any."""
    for point in points:
        if point.any():
            errors = dict(zip(keys, point.tolist(), strict=True))
            yield Member(errors, _changed(slew.testbed, errors).model().with_time_zero(slew.begin))


def _points(settings: Ensemble) -> Matrix:
    """Return the relative errors of the members, shape (members, keys)."""
    ranges = np.array(list(settings.vary.values()), dtype=np.float64).reshape(-1, 2)
    if not len(ranges):
        return np.zeros((1, 0))
    if settings.draw == "sampled":
        from scipy.stats import qmc  # takes longer to load than all planners

        sequence = qmc.Sobol(len(ranges), rng=np.random.default_rng(settings.seed))
        with np.errstate(all="ignore"):
            unit = sequence.random_base2(int(np.ceil(np.log2(settings.count))))[: settings.count]
        return np.asarray(ranges[:, 0] + unit * np.diff(ranges, axis=1)[:, 0])
    levels = 2 if settings.draw == "corners" else settings.count
    axes = [
        np.unique(np.linspace(ends[0], ends[1], levels)) if levels > 1 else [0.0] for ends in ranges
    ]
    return np.array(list(itertools.product(*axes)), dtype=np.float64)


def _changed(testbed: Testbed, errors: dict[str, float]) -> Testbed:
    """Return the testbed with relative errors of some of its numbers.

    Raises:
        BadInput: it has no such number.
    """
    factors = {key: 1.0 + error for key, error in errors.items() if key in _SCALE_KEYS}
    known = flat(plain(testbed))
    for key, error in errors.items():
        if key in _SCALE_KEYS:
            continue
        name = key.removeprefix(_PREFIX)
        value = known.get(name)
        if not isinstance(value, int | float) or isinstance(value, bool):
            numbers = [k for k, v in known.items() if isinstance(v, float)]
            raise BadInput(
                f"{name} is no number of the testbed; allowed: "
                f"{', '.join((*_SCALE_KEYS, *numbers))}",
                "plan",
                "ensemble.vary",
            )
        changes: Any = value * (1.0 + error)
        for part in reversed(name.split(".")):
            changes = {part: changes}
        trust = Trust(frozenset({testbed.kind}))
        testbed = with_changes(testbed, changes, f"plan: ensemble: {name}", trust)
    return testbed.scaled(**factors) if factors else testbed
