"""Estimators that assume less motion at the start than the testbed has."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from flexslew_control.controllers import CONTROLLERS, law_values
from flexslew_lab.trial.trial import Trial, law_of
from flexslew_plant.settings import plain, validated
from flexslew_plant.testbeds import initial_state, starts_in_motion

_KEY, _LARGE = "initial_deflection", 3.0  # standard deviations


def assumed_rest(trial: Trial) -> Iterator[str]:
    """Yield a line for each estimator whose initial covariance excludes the initial deflection."""
    if not starts_in_motion(trial.testbed):
        return
    model = trial.testbed.model()
    modes = model.split(initial_state(trial.testbed))[0][model.positions - model.modes :]
    deflection = float(np.abs(modes).max(initial=0.0))
    for name, section in trial.controllers.items():
        law, values = law_of(name, section or {})
        if law not in CONTROLLERS:
            continue
        settings = plain(validated(CONTROLLERS[law].settings, law_values(values), law))
        for path, deviation in _deviations(settings, f"controllers.{name}"):
            if deflection > _LARGE * deviation:
                yield (
                    f"{path}: {deviation:g} m assumes appendages at rest; the testbed starts with "
                    f"a mode at {deflection:.3g} m, so the first estimates are wrong; give as much"
                )


def _deviations(settings: Any, path: str) -> Iterator[tuple[str, float]]:
    """Yield the standard deviations of initial deflections, and where they are set."""
    for key, value in settings.items() if isinstance(settings, dict) else ():
        if key == _KEY and isinstance(value, int | float):
            yield f"{path}.{key}", float(value)
        yield from _deviations(value, f"{path}.{key}")
