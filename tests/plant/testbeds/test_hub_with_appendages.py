import numpy as np
import pytest

from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import read_testbed
from flexslew_plant.testbeds.hub_with_appendages import (
    HubParameters,
    HubTestbed,
    energy_coefficients,
)

STATE = np.array([0.3, 0.05, 0.8, -0.4])


def test_the_integrated_mode_gives_the_published_coefficients() -> None:
    e = energy_coefficients(HubParameters())
    assert e[:8] == pytest.approx(
        (18.09815, -8.902248, 18.278027, 13.152322, 17.930085, 17.653088, 73.112108, 170.310339),
        abs=6e-7,
    )
    assert HubParameters().bending_stiffness == pytest.approx(74.598524, abs=1e-6)


def test_the_frequency_with_the_hub_free_is_the_published_one() -> None:
    model = HubTestbed().model()
    assert model.linearise(np.zeros(2)).frequencies == pytest.approx([6.486746], abs=1e-6)


def test_energy_stays_without_effort_and_momentum_too() -> None:
    model = HubTestbed().model()
    after = model.advance(STATE, np.zeros(1), 10.0, 2000)
    assert model.energy(after) == pytest.approx(model.energy(STATE), rel=1e-12)
    assert model.momentum(after)[0] == pytest.approx(model.momentum(STATE)[0], rel=1e-12)


def test_a_misspelt_key_is_named() -> None:
    with pytest.raises(BadInput, match="did you mean tip_mass"):
        read_testbed(
            {"kind": "hub_with_appendages", "parameters": {"tip_mas": 1.0}},
            "trial.yaml",
        )
