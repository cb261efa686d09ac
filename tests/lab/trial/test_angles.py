"""An angle of more than a turn is allowed, with a line that names the degrees."""

import pytest

from flexslew_lab.trial.angles import doubtful_angles
from flexslew_lab.trial.sources import read_trial
from flexslew_plant.errors import BadInput

LINE = "{}: {:g} rad is {} turns; write {:g} deg if you mean degrees"


@pytest.mark.parametrize(
    ("trial", "change", "place", "angle", "turns"),
    [
        ("m1", "plan.goal.base_yaw=60", "plan.goal.base_yaw", 60.0, "9.5"),
        ("m1", "testbed.initial.hub_pitch=-30", "testbed.initial.hub_pitch", -30.0, "4.8"),
        ("observatory", "plan.goal={axis: [0, 0, 1], angle: 90}", "plan.goal.angle", 90.0, "14.3"),
    ],
)
def test_degrees_without_their_unit_are_named(
    trial: str, change: str, place: str, angle: float, turns: str
) -> None:
    found = [*doubtful_angles(read_trial(trial, [change])[0])]
    assert found == [LINE.format(place, angle, turns, angle)]


@pytest.mark.parametrize(
    ("trial", "change"),
    [
        ("m1", "plan.goal.base_yaw=60 deg"),
        ("m1", "plan.goal.base_yaw=6.28"),
        ("acc_benchmark", "plan.goal.mass=60"),  # [m]
    ],
)
def test_an_angle_within_a_turn_and_a_length_raise_no_doubt(trial: str, change: str) -> None:
    assert [*doubtful_angles(read_trial(trial, [change])[0])] == []


def test_an_angle_beyond_its_bound_is_refused_with_the_degrees() -> None:
    cone = "testbed.keep_out={sun: {half_angle: 30}}"
    with pytest.raises(BadInput, match=r"half_angle: 30 .*; write 30 deg if you mean degrees"):
        read_trial("observatory", [cone])
