"""Angles of a trial that were probably meant in degrees."""

from collections.abc import Iterator, Mapping
from math import pi
from typing import Any

from flexslew_lab.trial.trial import Trial
from flexslew_plant.settings import is_section, plain


def doubtful_angles(trial: Trial) -> Iterator[str]:
    """Yield one line for each angle of more than a turn among the goals and initial positions.

    Such a goal is allowed, since a joint without stops may turn many times.
    """
    units = trial.testbed.model().units_by_joint
    for place, section in (("plan", trial.plan), ("testbed", trial.testbed)):
        for key in ("goal", "initial"):
            for name, value in _angles(getattr(section, key, None), units):
                if isinstance(value, int | float) and abs(value) > 2.0 * pi:
                    yield (
                        f"{place}.{key}.{name}: {value:g} rad is {abs(value) / (2.0 * pi):.1f} "
                        f"turns; write {value:g} deg if you mean degrees"
                    )


def _angles(given: Any, units: Mapping[str, str]) -> Iterator[tuple[str, Any]]:
    """Yield the angles [rad] of joints, or of an attitude, by name."""
    positions = plain(given) if is_section(given) else given
    for name, value in positions.items() if isinstance(positions, dict) else ():
        if name == "euler" and value is not None:
            yield from ((f"euler.{i}", angle) for i, angle in enumerate(value))
        elif name == "angle" or units.get(name) == "rad":
            yield name, value
