"""Appendages that leave the range of small deflections are told of, once, in log and report."""

from pathlib import Path

import pytest

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.reproduce.scole_flights import example_trial
from flexslew_lab.run.run_trial import run_trial
from flexslew_plant.events import LargeDeflection, message_of


def told(tmp_path: Path, torque: float) -> tuple[list[LargeDeflection], str]:
    push = [{"at": 0.5, "until": 0.8, "disturbance": {"roll": torque}}]
    soft = {"appendages": {name: {"stiffness": 0.05} for name in ("left", "right")}}
    trial = example_trial("own_spacecraft", {"schedule": push, "duration": 3.0, "testbed": soft})
    run_trial(trial, "own_spacecraft", tmp_path / "run", in_process=True)
    events = BagReader(tmp_path / "run" / "bag").overview.events
    page = (tmp_path / "run" / "report.html").read_text()
    return [e.what for e in events if isinstance(e.what, LargeDeflection)], page


@pytest.mark.slow
def test_a_panel_that_bends_by_more_than_a_tenth_of_its_length_is_told_of(tmp_path: Path) -> None:
    facts, page = told(tmp_path, 400.0)
    assert sorted(fact.channel for fact in facts) == ["left_z", "right_z"]  # once each
    for fact in facts:
        assert 0.2 < fact.small < 0.3  # of panels of nearly 3 m
        assert abs(fact.deflection) > fact.small
        assert message_of(fact) in page


@pytest.mark.slow
def test_small_deflections_are_not_told_of(tmp_path: Path) -> None:
    facts, page = told(tmp_path, 1.0)
    assert facts == []
    assert "no longer hold" not in page
