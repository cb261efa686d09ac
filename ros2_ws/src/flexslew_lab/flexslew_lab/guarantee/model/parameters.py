"""What may be uncertain in a trial, and the sampled loop at any of its values."""

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from flexslew_lab.guarantee.box import Box
from flexslew_lab.guarantee.model.mode_changes import mode_key
from flexslew_lab.guarantee.model.situation import NAMED, Situation
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.keys.units import number_in
from flexslew_plant.settings import plain

Spread: TypeAlias = float | str | Sequence[float | str]  # of one parameter
Vary: TypeAlias = Mapping[str, Spread]

DEFAULT = {"stiffness": 0.2, "payload": 0.2}  # as the other plants of an analysis


class Uncertain(NamedTuple):
    """One parameter.

    Args:
        name: as it was given.
        nominal: of the trial.
        low, high: its range.
        unit: of these.
        relative: half of the range, of the nominal value; None: given as two ends.
    """

    name: str
    nominal: float
    low: float
    high: float
    unit: str
    relative: float | None


def uncertain_parameters(situation: Situation, vary: Vary) -> tuple[Uncertain, ...]:
    """Return the uncertain parameters of a trial.

    Args:
        situation: of the trial.
        vary: name (see NAMED) to half of the range relative to the nominal value (0.2 or "20 %"),
            or to its two ends ([0.5, 2.0], with units as in a trial file).

    Raises:
        BadInput: if a name or a range is not understood, or has no effect.
    """
    if not vary:
        raise BadInput(f"give at least one parameter; allowed: {', '.join(NAMED)}", key="vary")
    return tuple(_parameter(situation, name, spread) for name, spread in vary.items())


def vary_of(assignments: Sequence[str]) -> Vary:
    """Return `name=20%` and `name=low..high` as ranges by name; a unit at the end is that of both.

    Raises:
        BadInput: if there is no `=`, or nothing on a side of it.
    """
    found: dict[str, Spread] = {}
    for assignment in assignments:
        name, _, text = (part.strip() for part in assignment.partition("="))
        if not name or not text:
            raise BadInput("give name=20% or name=low..high", "--vary", value=assignment)
        ends = [end.strip() for end in text.split("..")]
        unit = re.fullmatch(r"[+-]?[0-9.]+(?:[eE][+-]?[0-9]+)?\s*([^0-9.\s].*)", ends[-1])
        numbers = [isinstance(_number(end), float) for end in ends]
        if unit and numbers == [True, False]:
            ends[0] = f"{ends[0]} {unit[1]}"
        found[name] = text if len(ends) == 1 else [_number(end) for end in ends]
    return found


def _number(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text  # a quantity, such as 5 ms


def box_of(parameters: Sequence[Uncertain]) -> Box:
    """Return the ranges of parameters as a box."""
    low, high = (np.array([getattr(p, key) for p in parameters]) for key in ("low", "high"))
    return Box((low + high) / 2.0, (high - low) / 2.0)


def loop_values(parameters: Sequence[Uncertain], values: Vector) -> dict[str, float]:
    """Return values by the names of parameters."""
    return {p.name: float(v) for p, v in zip(parameters, values, strict=True)}


def largest_scale(parameters: Sequence[Uncertain], most: float) -> float:
    """Return how far ranges can grow about their centres until one of them touches zero [-].

    A range that begins at zero or below does not grow.
    """
    limits = [most]
    for p in parameters:
        centre, radius = (p.low + p.high) / 2.0, (p.high - p.low) / 2.0
        limits.append(1.0 if p.low <= 0.0 else 0.98 * centre / radius)
    return max(1.0, min(limits))


def _parameter(situation: Situation, name: str, spread: Spread) -> Uncertain:
    nominal, unit = _nominal(situation, name)
    if isinstance(spread, float | int | str):
        share = _share(name, spread)
        if nominal == 0.0:
            raise BadInput(
                "is zero in this trial: give its two ends", key=f"vary.{name}", value=spread
            )
        low, high = sorted((nominal * (1.0 - share), nominal * (1.0 + share)))
        return _allowed(Uncertain(name, nominal, low, high, unit, share))
    if len(spread) != 2:
        raise BadInput("two ends, low and high", key=f"vary.{name}", value=list(spread))
    low, high = (number_in(end, (unit or "-",), f"vary.{name}") for end in spread)
    return _allowed(Uncertain(name, nominal, low, high, unit, None))


def _share(name: str, spread: float | str) -> float:
    """Return half of a range relative to the nominal value."""
    text = str(spread).strip()
    number = re.fullmatch(r"(?:\+-|±)?\s*([0-9.eE+-]+)\s*(%?)", text)
    try:
        share = float(number[1]) * (0.01 if number[2] else 1.0) if number else np.nan
    except ValueError:
        share = np.nan
    if not 0.0 < share < 1.0:
        raise BadInput("between 0 and 1, or as 20 %, or two ends", key=f"vary.{name}", value=spread)
    return share


def _allowed(parameter: Uncertain) -> Uncertain:
    p = parameter
    if not (np.isfinite(p.low) and np.isfinite(p.high) and p.low < p.high):
        raise BadInput(
            "low end below high end, finite", key=f"vary.{p.name}", value=[p.low, p.high]
        )
    if p.low < 0.0 and not p.name.startswith("testbed."):
        raise BadInput("0 or more", key=f"vary.{p.name}", value=p.low)
    return p


def _nominal(situation: Situation, name: str) -> tuple[float, str]:
    """Return the value of a parameter in the trial, and its unit."""
    joints = situation.rest.model.joint_names
    if name in ("stiffness", "payload", "gain"):
        return 1.0, ""
    if name.startswith("gain.") and name.partition(".")[2] in joints:
        return 1.0, ""
    if name == "lag":
        return situation.path.actuator.lag, "s"
    if name == "delay":
        return 0.0, "s"
    if (mode := mode_key(name)) is not None:
        modes = situation.natural_modes
        if mode[0] >= len(modes):
            words = f"the plant has {len(modes)} modes, mode.1 is the slowest"
            raise BadInput(words, key=f"vary.{name}")
        return getattr(modes[mode[0]], mode[1]), "rad/s" if mode[1] == "frequency" else ""
    if name.startswith("testbed."):
        value: Any = plain(situation.testbed)
        for part in name.split(".")[1:]:
            value = value.get(part) if isinstance(value, Mapping) else None
        if isinstance(value, int | float) and not isinstance(value, bool):
            return float(value), ""
        raise BadInput("is no number of this testbed's section", key=f"vary.{name}")
    known = ", ".join(NAMED)
    raise BadInput(f"vary: no parameter {name!r}; allowed: {known}")
