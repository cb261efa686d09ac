"""The modes that a command is shaped for, with the intervals in which they lie."""

from typing import Annotated, Any, NamedTuple, TypeAlias

import numpy as np
from pydantic import BeforeValidator, Field
from scipy.linalg import eigh

from flexslew_control.planners.slew import Slew
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.named_file import data_of_file
from flexslew_plant.own_code import Trust
from flexslew_plant.settings import NonNegative, Positive, section, validated

_LIGHT = 0.3  # damping ratio of a pole below which it is shaped
_POINTS = 41  # frequencies of an interval at which the residual is computed


@section
class IdentifiedNumber:
    """A number and its interval, as `flexslew identify` writes them."""

    value: NonNegative  # the estimate
    low: float | None = None  # lower end of its interval; null: the value
    high: float | None = None  # upper end of its interval; null: the value


def _with_interval(given: Any) -> Any:
    """Return a plain number as an estimate."""
    number = isinstance(given, int | float) and not isinstance(given, bool)
    return {"value": given} if number else given


Number: TypeAlias = Annotated[
    IdentifiedNumber,
    BeforeValidator(_with_interval, json_schema_input_type=IdentifiedNumber | NonNegative),
]


@section
class IdentifiedMode:
    """A mode as `flexslew identify` writes it; a plain number is an interval of no width."""

    frequency: Number  # [rad/s]
    damping_ratio: Number = IdentifiedNumber(value=0.0)  # [-]
    periods: Positive | None = None  # periods of the mode in the record; not used

    def __post_init__(self) -> None:
        """Refuse an interval without the value in it.

        Raises:
            ValueError: in words for the section's reader.
        """
        for key, number in (("frequency", self.frequency), ("damping_ratio", self.damping_ratio)):
            low, high = _ends(number)
            if not low <= number.value <= high:
                raise ValueError(f"{key}: {number.value:g} is not between {low:g} and {high:g}")
        if _ends(self.frequency)[0] <= 0.0:
            raise ValueError("frequency: above 0 rad/s, the lower end of its interval too")


Modes: TypeAlias = Annotated[tuple[IdentifiedMode, ...], Field(max_length=64)]


class ShapedMode(NamedTuple):
    """A mode to shape: its value, and the ends of its intervals."""

    frequency: float  # [rad/s]
    damping: float  # [-]
    frequencies: tuple[float, float]  # [rad/s]
    dampings: tuple[float, float]  # [-]

    def grid(self) -> tuple[Vector, Vector]:
        """Return frequencies and damping ratios at which a shaper is examined."""
        frequencies = np.append(np.linspace(*self.frequencies, _POINTS), self.frequency)
        return frequencies, np.unique([*self.dampings, self.damping])


def shaped_mode(mode: IdentifiedMode) -> ShapedMode:
    """Return an identified mode as one to shape; negative damping counts as none."""
    low, high = _ends(mode.damping_ratio)
    below_critical = min(max(high, 0.0), 0.99)
    return ShapedMode(
        mode.frequency.value,
        mode.damping_ratio.value,
        _ends(mode.frequency),
        (max(low, 0.0), below_critical),
    )


def around(frequency: float, damping: float, error: float) -> ShapedMode:
    """Return a mode whose frequency is known but for a relative error."""
    return ShapedMode(
        frequency, damping, (frequency * (1.0 - error), frequency * (1.0 + error)), (damping,) * 2
    )


def modes_along(slew: Slew, feedforward: bool, damping: float) -> list[tuple[float, float]]:
    """Return frequency [rad/s] and damping ratio of each mode that a followed trajectory excites.

    With efforts that move the joints along it, the modes swing as with the joints held. Without
    them kp and kd alone move the joints, and the lightly damped poles of their loop are excited.

    Args:
        slew: model and gains.
        feedforward: whether the joints follow as if they were held.
        damping: of the modes with the joints held [-].
    """
    model = slew.model
    lead, linear = model.before_modes, model.linearise(model.rest(slew.named(slew.goal)))
    if feedforward:
        blocks = linear.stiffness[lead:, lead:], linear.mass[lead:, lead:]
        return [(float(np.sqrt(w)), damping) for w in eigh(*blocks, eigvals_only=True) if w > 0.0]
    poles = linear.with_feedback(slew.kp, slew.kd).eigenvalues
    pairs = [(float(abs(p)), float(-p.real / abs(p))) for p in poles if p.imag > 0.0]
    return sorted((w, max(zeta, 0.0)) for w, zeta in pairs if zeta < _LIGHT)


def modes_of_file(path: str, source: str, trust: Trust) -> list[dict[str, Any]]:
    """Return the modes of an identified.yaml as values of the key `modes`.

    The joints follow a command, so a mode swings as with the joints held: where the file has these
    frequencies (`appendage`), they are taken, with the relative intervals of the free modes.

    Raises:
        Untrusted: if a log names the file.
        BadInput: the file cannot be read, or holds no modes.
    """
    place = f"{source}: modes: {path}"
    values = data_of_file(path, f"{source}: modes", trust)
    given = values.get("modes") if isinstance(values, dict) else None
    if not isinstance(given, list) or not given:
        raise BadInput("holds no `modes`; `flexslew identify` writes them", place)
    modes: Any = validated(Modes, given, place)
    appendage = values.get("appendage") or {}
    clamped = appendage.get("frequencies") if isinstance(appendage, dict) else None
    factors = np.ones(len(modes))
    if isinstance(clamped, list) and len(clamped) == len(modes):
        factors = np.array(clamped, dtype=float) / [mode.frequency.value for mode in modes]
    return [
        {
            "frequency": _scaled(mode.frequency, float(factor)),
            "damping_ratio": _scaled(mode.damping_ratio, 1.0),
        }
        for mode, factor in zip(modes, factors, strict=True)
    ]


def _scaled(number: IdentifiedNumber, factor: float) -> dict[str, float]:
    low, high = _ends(number)
    return {"value": factor * number.value, "low": factor * low, "high": factor * high}


def _ends(number: IdentifiedNumber) -> tuple[float, float]:
    low, high = number.low, number.high
    return (number.value if low is None else low), (number.value if high is None else high)
