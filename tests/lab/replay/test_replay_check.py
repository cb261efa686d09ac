"""Recorded measurements into controllers: the same one, a gain off by a millionth, another law."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.present import present

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.checks.check import check_log
from flexslew_lab.log.messages.cdr import decode, encode
from flexslew_lab.log.recording.bag_writer import BagWriter
from flexslew_lab.metrics.from_bag import metrics_of
from flexslew_lab.replay.check import FIELDS, check, difference_page
from flexslew_lab.replay.resim import resim
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import parse_trial
from flexslew_plant.errors import BadInput

TRIAL = """
name: checked
duration: 6.0
plan:
  method: reference_only
  model: {variant: complete, modes: 1}
  goal: {base_yaw: 0.1, hub_pitch: 0.05}
  duration: 5.0
controllers: {pd_feedforward: {kp: [460.0, 460.0]}, output_feedback: {}}
schedule: [{at: 3.0, switch: output_feedback}]
"""


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("checked") / "run"
    run_trial(parse_trial(TRIAL, "test"), "test", folder, in_process=True, report=False)
    return folder / "bag"


@pytest.mark.parametrize("name", ["pd_feedforward", "output_feedback"])
def test_the_recorded_controller_says_every_number_again(flown: Any, name: str) -> None:
    result = check(flown, name)
    assert result.ok
    assert result.first_divergence is None
    assert (result.ticks, result.only_recorded, result.only_ours) == (300, 0, 0)
    assert [row.field for row in result.rows] == list(FIELDS)
    assert all(row.compared == 300 and row.different == 0 for row in result.rows)


def test_a_log_without_a_choice_of_observer_is_that_of_the_steady_one(tmp_path: Path) -> None:
    words = TRIAL.replace("output_feedback: {}", "output_feedback: {observer: steady}")
    run_trial(parse_trial(words, "test"), "test", tmp_path / "new", in_process=True, report=False)
    bag = BagReader(tmp_path / "new" / "bag")
    metadata = bag.metadata | {"trial": bag.trial_text.replace("observer: steady", "")}
    with BagWriter(tmp_path / "old", metadata) as writer:
        for topic, kind, stamp, _, data in bag.messages():
            if topic == "/controller_status":
                message = decode(kind, data)
                lines = message.settings.splitlines()
                message.settings = "\n".join(x for x in lines if not x.startswith("observer:"))
                data = encode(kind, message)
            writer.write(topic, kind, data, stamp)
        writer.close({})
    assert check(tmp_path / "old", "output_feedback").ok
    assert resim(tmp_path / "old").identical


def test_repeated_questions_and_answers_count_once_in_check_and_resim(
    flown: Any, tmp_path: Path
) -> None:
    bag = BagReader(flown)
    with BagWriter(tmp_path / "run", bag.metadata) as writer:
        for topic, kind, stamp, _, data in bag.messages():
            asked = topic in ("/measurement", "/effort_command", "/controller_state")
            for _ in range(3 if asked and stamp % 70_000_000 == 0 else 1):
                writer.write(topic, kind, data, stamp)
        writer.close({})
    assert all(finding.ok for finding in check_log(tmp_path / "run"))
    for name in ("pd_feedforward", "output_feedback"):
        assert check(tmp_path / "run", name)[:6] == check(flown, name)[:6]
    again = resim(tmp_path / "run")
    assert again.identical
    assert again.hash == metrics_of(tmp_path / "run")["trajectory_hash"]
    assert again.hash == metrics_of(flown)["trajectory_hash"]


def test_a_gain_off_by_a_millionth_is_found_at_its_first_tick(flown: Any) -> None:
    result = check(flown, "pd_feedforward", settings={"kp": [460.0 * (1 + 1e-6), 460.0]})
    assert not result.ok
    found = present(result.first_divergence)
    assert (found.epoch, found.tick, found.field) == (0, 1, "terms.proportional[0]")
    assert found.ours / found.recorded == pytest.approx(1 + 1e-6, abs=1e-12)
    rows = {row.field: row for row in result.rows}
    assert rows["effort"].first_tick == 1
    assert rows["effort"].different > 250
    assert 0.0 < rows["effort"].relative < 2e-6
    assert rows["estimate_position"].different == 0


def test_an_absolute_change_of_a_millionth_is_found_too(flown: Any) -> None:
    assert check(flown, "pd_feedforward", settings={"kp": [460.0 + 1e-6, 460.0]}).rows[-1].different


def test_another_law_differs_in_its_fields(flown: Any) -> None:
    result = check(flown, "pd_feedforward", law="lqr")
    assert result.law == "lqr"
    assert not result.ok
    assert present(result.first_divergence).tick == 0
    assert any(row.largest == np.inf for row in result.rows)  # other states, other lengths


def test_the_figure_shows_the_differences(flown: Any) -> None:
    same = difference_page(check(flown, "pd_feedforward"))
    other = difference_page(check(flown, "pd_feedforward", settings={"kp": [461.0, 460.0]}))
    names = r'data-name="(\w+)"'
    assert "No difference." in same
    assert not re.findall(names, same)
    assert set(re.findall(names, other)) == {"terms", "effort"}


def test_a_controller_that_is_not_in_the_log_is_refused(flown: Any) -> None:
    with pytest.raises(BadInput, match=r"no controller nobody; it has pd_feedforward"):
        check(flown, "nobody")


def test_a_wrong_setting_is_refused(flown: Any) -> None:
    with pytest.raises(BadInput, match="kpp"):
        check(flown, "pd_feedforward", settings={"kpp": 1.0})
