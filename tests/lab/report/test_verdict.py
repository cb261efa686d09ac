"""The verdict on top of a report, and the story of what an operator did."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from tests.plants import plant

from flexslew_control.planners import make_plan, plan_settings
from flexslew_lab.log.messages.cdr import encode
from flexslew_lab.metrics.rows import unit_of
from flexslew_lab.report.report import write_report
from flexslew_lab.report.verdict import joints_to_move, model_difference, plan_verdict, run_summary

Message = tuple[str, bytes, int]
GOOD: dict[str, Any] = {
    "residual_tip_deflection": 0.0125,
    "manoeuvre_start": 2.0,
    "overshoot": {"yaw": 0.1, "pitch": 0.0, "roll": None},
    "settling_time": {"yaw": 20.0, "pitch": 21.5, "roll": None},
    "residual_attitude_error": {"yaw": 1e-4, "pitch": 2e-4, "roll": 1.0},
    "saturated_time": 0.0,
    "missed_ticks": 0,
    "faults": 0,
    "fallbacks": 0,
    "goal_error": 0.0,
}


@pytest.mark.parametrize(
    ("changed", "without", "words"),
    [
        ({}, 5.0, "400 times less ringing than without feedforward (0.0125 m, not 5 m)"),
        ({}, 0.0127, "as much ringing as without feedforward"),
        ({}, 0.00125, "10 times more ringing than without feedforward"),
        (
            {},
            None,
            "tip deflection after the manoeuvre: 0.0125 m; settled at 23.5 s; no effort at its",
        ),
        (
            {"settling_time": {"yaw": None, "pitch": 1.0}},
            None,
            "not settled: yaw; no effort at its limit",
        ),
        ({"manoeuvre_start": 1230.0}, None, "settled at 1252 s; no effort"),
        ({"saturated_time": 2345.6}, None, "efforts at their limit for 2346 s"),
        (  # a bench without tips
            {"residual_tip_deflection": 0.0, "peak_tip_deflection": 0.0},
            0.0,
            "largest error after the manoeuvre: pitch 0.0002; settled at 23.5 s",
        ),
        ({"saturated_time": 1.5}, None, "settled at 23.5 s; efforts at their limit for 1.5 s"),
        ({"overshoot": {"yaw": None}}, None, "tip deflection after the manoeuvre: 0.0125 m; no"),
        ({"missed_ticks": 1, "faults": 2}, None, "1 tick without an answer; 2 faults"),
        ({"residual_tip_deflection": None}, 5.0, "the manoeuvre was not completed; settled"),
        (
            {"residual_tip_deflection": None, "peak_tip_deflection": 0.25},
            None,
            "tip deflection up to 0.25 m; the manoeuvre was not completed",
        ),
        (
            {"residual_tip_deflection": None, "peak_tip_deflection": {"left": 0.1, "right": 0.2}},
            None,
            "tip deflection up to 0.2 m; the manoeuvre was not completed",
        ),
        ({"final_error": {"yaw": None, "pitch": None}}, 5.0, "tip deflection up to 0.0125 m; "),
        ({"goal_error": 0.5, "final_error": {"yaw": 0.5}}, None, "goal missed by 50 %"),
    ],
)
def test_the_verdict_says_what_the_fields_hold(
    changed: dict[str, Any], without: float | None, words: str
) -> None:
    bare = {} if without is None else {"residual_tip_deflection": without}
    assert words in run_summary({**GOOD, **changed}, bare, 0.1)


def test_a_run_that_an_operator_changed_is_compared_with_nothing() -> None:
    words = run_summary(GOOD, {"residual_tip_deflection": 5.0}, 0.1, changes=3)
    assert words.startswith("changed by an operator 3 times; tip deflection after")
    assert "feedforward" not in words


def test_joints_with_a_commanded_move_come_in_the_order_of_the_bench() -> None:
    assert joints_to_move(GOOD) == ("yaw", "pitch")
    assert joints_to_move({"overshoot": {"a": None, "b": None}}) == ("a", "b")


def test_a_session_is_told_as_a_story_and_repeated_by_its_log(
    bag: Path, tmp_path: Path, write_bag: Callable[..., Path], messages: list[Message]
) -> None:
    data = {"controller": "pi", "strict": False, "max_effort_step": 1.0, "who": "anna"}
    values = {"tick": 250, "kind": "switch_requested", "message": "to pi", "data": json.dumps(data)}
    asked = ("/events", encode("flexslew_msgs/msg/Event", values), 2_500_000_000)
    session = write_bag(tmp_path / "session", [*messages, asked])
    told = write_report([session], tmp_path / "a.html", comparison=bag).read_text()
    assert "What happened" in told
    assert "<td>anna</td>" in told
    assert "Changed by an operator once" in told
    assert "without feedforward" not in told
    assert "./flexslew resim" in told
    plain = write_report([bag], tmp_path / "b.html", comparison=bag).read_text()
    assert "What happened" not in plain
    assert "without feedforward" in plain


def test_every_entry_of_the_contents_leads_somewhere(bag: Path, tmp_path: Path) -> None:
    page = write_report([bag], tmp_path / "a.html").read_text()
    links = page.split('<ul class="contents">')[1].split("</ul>")[0].split('href="#')[1:]
    assert len(links) > 5
    for entry in links:
        assert f'id="{entry.split(chr(34))[0]}"' in page


@pytest.mark.parametrize(("kind", "unit"), [("m", "N^2 s"), ("rad", "(N m)^2 s")])
def test_the_square_of_forces_is_told_in_newtons(kind: str, unit: str) -> None:
    assert unit_of("control_effort", [kind]) == unit


def test_what_is_told_of_a_joint_has_its_unit() -> None:
    units = {"yaw": "rad", "pitch": "m"}
    held = GOOD | {"residual_tip_deflection": 0.0, "peak_tip_deflection": 0.0}
    assert "pitch 0.0002 m; settled" in run_summary(held, {}, 0.02, 0, units)
    missed = GOOD | {"goal_error": 0.5, "final_error": {"yaw": 0.5, "pitch": -0.1}}
    assert "final error: yaw 0.5 rad, pitch -0.1 m;" in run_summary(missed, {}, 0.02, 0, units)


def test_the_drives_that_acted_are_named() -> None:
    metrics = {
        "peak_effort": {"roll": 3.0, "w1": 0.0, "w2": 1.0, "w3": None},
        "saturated_time": 0.0,
    }
    assert run_summary(metrics, {}, 0.1).endswith("driven by roll, w2; no effort at its limit")


def test_a_plan_states_its_residual_its_drives_and_its_model() -> None:
    made = make_plan(plan_settings({"method": "reference_only"}, "t.yaml"), plant())
    assert plan_verdict(made, (150.0, 150.0)).startswith("predicted tip deflection after the mano")
    assert "no feedforward" in plan_verdict(made, (150.0, 150.0))
    pushed = replace(made, effort=0.0 * made.effort + [75.0, 15.0], summary={"converged": False})
    assert "at most 50 % of the limit of base_yaw" in plan_verdict(pushed, (150.0, 150.0))
    assert plan_verdict(pushed, (150.0, 150.0)).startswith("the planner has not converged; ")
    assert model_difference({"believes": "1 mode instead of 3"}) == (
        "planned on a model with 1 mode instead of 3"
    )
    assert model_difference({}) == model_difference(None) == ""
