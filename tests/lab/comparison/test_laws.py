"""The same manoeuvre by every law: what the table and the page say is what was flown."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from flexslew_control.controllers import CONTROLLERS
from flexslew_lab.comparison.comparison import Comparison, compare_candidates
from flexslew_lab.comparison.laws import NO_FEEDBACK, laws
from flexslew_lab.comparison.page import comparison_page
from flexslew_lab.comparison.winners import verdict, winners
from flexslew_lab.reproduce.scole_flights import example_trial
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import parse_trial
from flexslew_plant.errors import BadInput

SHORT = {"duration": 0.6, "plan": {"duration": 0.4}}
YAW = """
name: yaw
duration: 12.0
period: 0.05
testbed: {kind: csa, modes: 1}
plan: {method: none, goal: {base_yaw: 0.2}, duration: 1.0}
controllers: {soft: {law: pd_feedforward, kp: [200.0], kd: [800.0]}, lqr: {}}
active: soft
schedule: [{at: 5.0, switch: lqr}]
"""


@pytest.fixture(scope="module")
def oscillator() -> Comparison:
    heard: list[tuple[int, int]] = []
    trial = example_trial("antenna_3", SHORT)
    found = compare_candidates(laws(trial, "antenna_3", (-0.2, 0.2)), lambda *at: heard.append(at))
    assert heard[-1][0] == heard[-1][1]
    assert [done for done, _ in heard] == list(range(1, len(heard) + 1))
    return found


def test_every_law_is_flown_or_says_in_one_line_why_not(oscillator: Comparison) -> None:
    names = [entry.name for entry in oscillator.entries]
    assert names[:3] == [f"planned_gains, {k}" for k in ("constant", "perturbation", "adiabatic")]
    assert names[-1] == NO_FEEDBACK
    of_files = {name for name, entry in CONTROLLERS.items() if entry.from_file is not None}
    assert of_files == {"linear", "policy"}  # which have no design in this trial
    assert {n.partition(",")[0] for n in names} == {*CONTROLLERS, NO_FEEDBACK} - of_files
    for name in of_files:
        assert f"{name} is left out: the trial has no design for it" in oscillator.note
    for entry in oscillator.entries:
        assert bool(entry.refused) != bool(entry.flights)
        assert "\n" not in entry.refused
    flown = {entry.name for entry in oscillator.simulated_entries}
    assert {"modal_space", "disturbance_accommodating", NO_FEEDBACK} <= flown


def test_the_law_in_charge_flies_as_in_its_trial(oscillator: Comparison, tmp_path: Path) -> None:
    own = run_trial(
        example_trial("antenna_3", SHORT), "t", tmp_path / "t", in_process=True, report=False
    )
    [entry] = [e for e in oscillator.entries if e.name == "planned_gains, perturbation"]
    assert entry.nominal.metrics["trajectory_hash"] == own.metrics["trajectory_hash"]


def test_no_feedback_gives_no_effort_and_control_is_worth_something(
    oscillator: Comparison,
) -> None:
    rows = {row["law"]: row for row in oscillator.rows()}
    alone = rows[NO_FEEDBACK]
    assert alone["effort"] == alone["peak_effort"] == 0.0
    for name in ("planned_gains, perturbation", "disturbance_accommodating", "modal_space"):
        assert rows[name]["joint_error"] < alone["joint_error"]
        assert set(rows[name]["by_stiffness"]) == {"-0.2", "+0.2"}
        for other in rows[name]["by_stiffness"].values():
            assert other["joint_error"] != rows[name]["joint_error"]


def test_the_page_shows_all_of_it_and_fetches_nothing(oscillator: Comparison) -> None:
    text = comparison_page(oscillator)
    for entry in oscillator.entries:
        assert entry.name.split(",")[0].split("_")[0] in text
    assert text.count("data-panels=") == 2
    assert "Robustness" in text
    assert "<script src" not in text
    assert "<link" not in text
    table = oscillator.table(oscillator.short)
    assert [name for name, _ in table] == [entry.name for entry in oscillator.simulated_entries]


def test_each_criterion_has_a_winner_and_none_that_lacks_a_number_wins(
    oscillator: Comparison,
) -> None:
    won = {w.criterion.key: w for w in winners(oscillator)}
    rows = {row["law"]: row for row in oscillator.rows()}
    for key, winner in won.items():
        known = [row[key] for row in rows.values() if row.get(key) is not None]
        assert winner.value == rows[winner.name][key] >= min(known)
        assert 0.0 < winner.value <= winner.second_value
        assert winner.name != NO_FEEDBACK or "effort" not in key
        assert 0 <= winner.first_on <= winner.benches == 3
    words = verdict(oscillator)
    assert words.startswith("least by ")
    assert f"joints, after the end: {won['joint_error'].name}" in words
    page = comparison_page(oscillator)
    assert page.index('class="verdict"') < page.index("<h2>Winners</h2>") < page.index("Numbers")


@pytest.mark.slow
def test_laws_of_a_slew_are_compared_by_its_joints_without_the_schedule_s_switches() -> None:
    found = compare_candidates(laws(parse_trial(YAW, "yaw.yaml"), "yaw.yaml", (0.3,)))
    rows: dict[str, dict[str, Any]] = {row["law"]: row for row in found.rows()}
    assert len(rows) == len(found.entries)
    assert [e.name for e in found.entries][:2] == ["soft", "lqr"]
    assert "pd_feedforward" not in rows  # it runs as soft
    assert "plan has no gains" in rows["planned_gains"]["refused"]
    assert "cannot follow a moving reference" in rows["modal_space"]["refused"]
    for name in ("soft", "lqr"):
        [entry] = [e for e in found.entries if e.name == name]
        assert {(f.stiffness, f.carried) for f in entry.flights} == {(0, 0), (0.3, 0), (0, 0.3)}
        assert entry.nominal.metrics["switches"] == 0
        assert rows[name]["by_inertia"]["+0.3"]["joint_error"] > 0.0


@pytest.mark.slow
def test_laws_that_cannot_fly_an_antenna_say_why() -> None:
    trial = example_trial("antenna_2", {"duration": 0.05})
    found = compare_candidates(laws(trial, "antenna_2", ()))
    refused = {entry.name: entry.refused for entry in found.entries if entry.refused}
    assert "not stable with a period of 0.01 s" in refused["collocated_pid"]
    flown = {entry.name for entry in found.simulated_entries}
    assert {"disturbance_minimisation", "modal_space", "output_feedback"} <= flown


def test_errors_that_leave_nothing_are_refused() -> None:
    trial = replace(example_trial("antenna_3", SHORT))
    with pytest.raises(BadInput, match="errors"):
        laws(trial, "antenna_3", (-1.0,))
