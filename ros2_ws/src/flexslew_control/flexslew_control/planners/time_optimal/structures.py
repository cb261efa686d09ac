"""Which switches a bang-bang slew has, and what leads to one where none was found."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Literal, TypeAlias

import numpy as np

from flexslew_control.planners.time_optimal.bang_bang import BangBang
from flexslew_control.planners.time_optimal.optimal_switching import (
    extremal_durations,
    five_switch_durations,
)
from flexslew_control.planners.time_optimal.switching import continued_durations
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import PlanFailed

Structure: TypeAlias = Literal["fewest", "asymmetric", "optimal"]
# of the amplitude, tried where the whole leads to no slew
_AMPLITUDE_RATIOS = (0.9, 0.75, 0.6, 0.45, 0.3)
_MODES_LEAD = "insensitive: modes leads to one"


def require_durations(slew: BangBang, structure: Structure) -> Vector:
    """Return the arcs of the slew; see found_durations.

    Raises:
        PlanFailed: if none were found; the message gives a change that leads to a slew.
    """
    try:
        return found_durations(slew, structure)
    except PlanFailed as error:
        raise PlanFailed(f"{error}; {_suggest_change(slew, structure)}") from None
    except FloatingPointError:
        if not _feasible_for_modes(slew, structure):
            raise
        raise PlanFailed(f"no robust slew was found; {_MODES_LEAD}") from None


def found_durations(slew: BangBang, structure: Structure = "fewest") -> Vector:
    """Return the arcs of the slew.

    Args:
        slew: what is turned.
        structure: of one mode in open loop: fewest, the shortest slew with three switches (robust:
            five), antisymmetric about its middle where the mode has no damping, with five where
            three fail; asymmetric, the shortest with as few, antisymmetric or not; optimal, as many
            as an extremal has. All else is optimal anyway.

    Raises:
        PlanFailed: none were found.
    """
    if not len(slew.combinations):  # a rigid body
        return np.full(2, 0.5 * slew.rigid_duration)
    finders: list[Callable[[BangBang], Vector | None]] = []
    if closed_form(slew):
        fewest = partial(continued_durations, antisymmetric=structure != "asymmetric")
        finders = [fewest, five_switch_durations]
    finders.insert(0 if structure == "optimal" else len(finders), extremal_durations)
    for finder in finders:
        try:
            durations = finder(slew)
        except PlanFailed:  # of this kind; another may be found
            continue
        if durations is not None:
            return durations
    raise PlanFailed(
        f"no{' robust' if slew.robust else ''} slew by {slew.distance:g} at {slew.amplitude:g} "
        f"was found (rigid bound {slew.rigid_duration:.4f} s)"
    )


def closed_form(slew: BangBang) -> bool:
    """Return whether slews with few switches are known of the linear model."""
    with_feedback = slew.robust and not slew.open_loop
    return len(slew.combinations) == 1 and slew.insensitive == "modes" and not with_feedback


def _feasible_for_modes(slew: BangBang, structure: Structure) -> bool:
    """Return whether there is a slew that leaves the joint free to be sensitive.

    Without feedback the joint of a linear plant is as sensitive as the modes are, so conditions on
    both are dependent.
    """
    also_joint = slew.robust and slew.insensitive == "state"
    return also_joint and _is_feasible(replace(slew, insensitive="modes"), structure)


def _suggest_change(slew: BangBang, structure: Structure) -> str:
    """Return a change that leads to a slew, after a try of it."""
    if _feasible_for_modes(slew, structure):
        return _MODES_LEAD
    if slew.robust:
        if _is_feasible(replace(slew, robust=False), structure):
            return "robust: false leads to one"
        return "robust: false leads to none either"
    for share in _AMPLITUDE_RATIOS:
        amplitude = float(f"{share * slew.amplitude:.3g}")
        if _is_feasible(replace(slew, amplitude=amplitude), structure):
            return f"amplitude: {amplitude:g} leads to one"
    least = _AMPLITUDE_RATIOS[-1] * slew.amplitude
    return f"no amplitude tried down to {least:.3g} leads to one"


def _is_feasible(slew: BangBang, structure: Structure) -> bool:
    """Return whether there is such a slew."""
    try:
        found_durations(slew, structure)
    except PlanFailed:
        return False
    return True
