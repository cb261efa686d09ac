"""Which shipped trials fly in a batch, and why the others do not."""

import numpy as np
import pytest

from flexslew_control.law import Reference
from flexslew_lab.studies.batch.fleet import form_of
from flexslew_lab.studies.batch.groups.batch_trial import (
    controller_of,
    fault_schedule_of,
    way_of_settings,
    way_of_testbed,
)
from flexslew_lab.studies.batch.groups.charge import charge_of
from flexslew_lab.studies.ways import Way
from flexslew_lab.trial.sources import example_trials, read_trial
from flexslew_lab.trial.trial import Trial
from flexslew_plant.arrays import EMPTY
from flexslew_plant.testbeds import initial_positions

FOR_THE_BENCH = {"predictive_m1": Way.LAW}


def way_of(trial: Trial) -> Way:
    """Return how a study flies a trial, from a reference that rests."""
    model = trial.testbed.model()
    charge = charge_of(trial, fault_schedule_of(trial, model).faults)
    if isinstance(charge, Way):
        return charge
    for way in (way_of_settings(trial, charge), way_of_testbed(model, trial.period)):
        if way is not Way.BATCH:
            return way
    still = np.array(list(initial_positions(trial.testbed).values()))
    references = [Reference(still, 0.0 * still, 0.0 * still, EMPTY)]
    forms = [form_of(trial, controller_of(trial, name), references) for _, name in charge.segments]
    return next((form for form in forms if isinstance(form, Way)), Way.BATCH)


@pytest.mark.parametrize("name", [shipped.name for shipped in example_trials()])
def test_every_shipped_trial_flies_in_batches_but_for_those_with_a_reason(name: str) -> None:
    trial, _ = read_trial(name, None)
    assert way_of(trial) is FOR_THE_BENCH.get(name, Way.BATCH)


def test_who_needs_a_reason_is_shipped() -> None:
    assert FOR_THE_BENCH.keys() <= {shipped.name for shipped in example_trials()}
