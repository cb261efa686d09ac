from typing import Any

import pytest

from flexslew_plant.bench.bench import Bench, BenchSettings
from flexslew_plant.bench.schedule import Schedule
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import validated


def read(*entries: Any) -> Any:
    return validated(Schedule, list(entries), "trial.yaml")


def test_entries_are_read_in_their_order() -> None:
    first, second = read(
        {"at": 40.0, "switch": "other"},
        {"at": 60.0, "until": 80.0, "disturbance": {"base_yaw": 5.0}},
    )
    assert (first.at, first.switch, first.disturbance) == (40.0, "other", None)
    assert (second.until, second.disturbance) == (80.0, {"base_yaw": 5.0})


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({"at": 1.0}, "exactly one of"),
        ({"at": 1.0, "switch": "a", "disturbance": {"base_yaw": 1.0}}, "exactly one of"),
        ({"at": 1.0, "until": 2.0, "switch": "a"}, "until is only for"),
        ({"at": 2.0, "until": 2.0, "disturbance": {"base_yaw": 1.0}}, "until must be later"),
        ({"at": -1.0, "switch": "a"}, "0.at: -1.0 is not allowed"),
        ({"switch": "a"}, "at"),
        ({"at": float("nan"), "switch": "a"}, "at: nan is not allowed"),
        ({"at": 1.0, "disturbance": {"base_yaw": float("inf")}}, "inf is not allowed"),
        ({"at": 1.0, "swich": "a"}, "did you mean switch"),
    ],
)
def test_a_wrong_entry_is_refused_in_one_line(entry: Any, words: str) -> None:
    with pytest.raises(BadInput, match=words) as caught:
        read(entry)
    assert str(caught.value).startswith("trial.yaml: 0")
    assert "\n" not in str(caught.value)


def test_a_disturbance_of_an_unknown_joint_is_refused() -> None:
    schedule = read({"at": 1.0, "disturbance": {"base_yav": 1.0}})
    with pytest.raises(BadInput, match=r"base_yav is not a joint.*base_yaw, hub_pitch"):
        Bench(BenchSettings(schedule=schedule))
