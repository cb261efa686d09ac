"""The trial that a bench flies now, from its own reports and those of its controllers."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from flexslew_control.controllers import COMPUTED_KEYS
from flexslew_lab.console.view import BenchView
from flexslew_lab.trial.overrides import override_values
from flexslew_lab.trial.trial import Trial, trial_of_values
from flexslew_plant.bench.records import BenchSettings
from flexslew_plant.errors import BadInput
from flexslew_plant.yaml_data import load_yaml


def current_trial(view: BenchView, controller: str, changes: Mapping[str, Any] = {}) -> Trial:
    """Return the trial of one controller of a bench, tuned as it is, without a plan.

    What was injected by hand is left out; the schedule's disturbances and faults are included.

    Args:
        view: view of the bench.
        controller: name of the active controller.
        changes: its settings that differ from those that it has reported.

    Raises:
        BadInput: if the bench or the controller has not reported its settings yet, or is code of
            the user's own that this process may not load.
    """
    known = view.controllers.get(controller)
    if known is None or not view.bench_settings:
        raise BadInput("the bench has not published its testbed and its controllers yet")
    record = load_yaml(view.bench_settings, "the bench")
    bench = record.get("bench", record)
    kept = {item.name for item in fields(BenchSettings)}
    values = {key: value for key, value in bench.items() if key in kept}
    schedule = [entry for entry in values.get("schedule") or () if not entry.get("switch")]
    settings = override_values(settings_of(known.settings), dict(changes))
    values |= {
        "schedule": schedule,
        "fallback": [],
        "controllers": {controller: {"law": known.law, **settings}},
        "active": controller,
    }
    duration = values.get("duration") or Trial.duration
    return trial_of_values({**values, "duration": duration}, "the bench", view.trust)


def settings_of(text: str) -> dict[str, Any]:
    """Return the settings that a controller announces, without what was computed from them."""
    found = load_yaml(text, "settings") or {}
    return {key: value for key, value in found.items() if key not in COMPUTED_KEYS}
