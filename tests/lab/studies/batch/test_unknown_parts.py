"""A bench with a part that batches do not know is flown trial by trial, with the reason."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from flexslew_lab.studies.batch.batch_metrics import needs_truth
from flexslew_lab.studies.batch.benches.batch_faults import is_supported
from flexslew_lab.studies.batch.groups.batch_trial import way_of_testbed
from flexslew_lab.studies.ways import Way
from flexslew_lab.trial.sources import read_trial
from flexslew_plant.faults import FAULTS
from flexslew_plant.testbeds import read_testbed

CRAFT = {"kind": "spacecraft", "sensors": {"gyro": {"kind": "gyro"}}}


@dataclass(frozen=True)
class OwnGyro:
    """A gyro that reads in a way of its own."""

    of: Any

    def __getattr__(self, name: str) -> Any:
        return getattr(self.of, name)

    def reader(self, period: float, rng: np.random.Generator | None) -> Any:
        return self.of.reader(period, rng)._replace(read=lambda *given: None)


def test_a_sensor_that_batches_do_not_know_goes_to_the_bench() -> None:
    model = read_testbed(CRAFT, "test").model()
    assert way_of_testbed(model, 0.01) is Way.BATCH
    own = tuple(OwnGyro(one) for one in model.appendages.instruments)
    assert own
    strange = replace(model, appendages=model.appendages._replace(instruments=own))
    assert way_of_testbed(strange, 0.01) is Way.SENSOR


@pytest.mark.parametrize("name", FAULTS)
def test_shipped_faults_fly_in_batches_and_their_heirs_do_not(name: str) -> None:
    kind = FAULTS[name].settings
    heir = type("Heir", (kind,), {})
    assert is_supported(object.__new__(kind))
    assert not is_supported(object.__new__(heir))


def test_only_a_platform_that_points_is_measured_from_its_truth() -> None:
    assert not needs_truth(read_trial("m1")[0])
    assert needs_truth(read_trial("own_spacecraft")[0])
