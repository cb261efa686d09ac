from typing import Any

import pytest

from flexslew_lab.report.run_data import read_run
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.sources import trial_path
from flexslew_lab.trial.trial import load_trial, parse_trial, trial_text
from flexslew_plant.errors import BadInput
from flexslew_plant.refusal import Cause

DEMO = trial_path("swap_demo")
LIMIT = 150.0  # [N m]


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, Any]:
    out = tmp_path_factory.mktemp("demo") / "run"
    result = run_trial(load_trial(DEMO), str(DEMO), out, in_process=True, report=False)
    return result, read_run(out)


def events(run: Any, *kinds: Any) -> list[Any]:
    return [event for event in run.overview.events if event.kind in kinds]


@pytest.mark.slow
def test_the_demo_ends_with_a_fault_and_a_whole_log(demo: tuple[Any, Any]) -> None:
    result, _ = demo
    assert result.exit_code == 3
    assert result.metrics["ticks"] == 10_000
    assert result.metrics["log_complete"]
    assert result.metrics["missed_ticks"] == 5


def test_the_log_tells_who_was_in_charge_when(demo: tuple[Any, Any]) -> None:
    _, run = demo
    found = [(phase.controller, phase.start) for phase in run.phases]
    assert [name for name, _ in found] == [
        "pd_feedforward",
        "output_feedback",
        "proportional_integral",
        "lqr",
    ]
    assert [start for _, start in found] == pytest.approx([0.0, 12.5, 45.0, 75.05], abs=0.011)


def test_no_swap_of_the_demo_has_a_step(demo: tuple[Any, Any]) -> None:
    _, run = demo
    swaps = events(run, "switched")
    assert [(swap.data["from"], swap.data["to"]) for swap in swaps] == [
        ("pd_feedforward", "output_feedback"),
        ("output_feedback", "proportional_integral"),
    ]
    for swap in swaps:
        assert max(map(abs, swap.data["effort_step"])) < 1e-9 * LIMIT


def test_the_silence_of_the_demo_is_found_and_handed_over(demo: tuple[Any, Any]) -> None:
    _, run = demo
    (fault,) = events(run, "fault")
    (fallback,) = events(run, "fallback")
    assert fault.data["fault"]["controller"] == "proportional_integral"
    assert fault.tick == 7500
    assert fallback.tick == 7504
    assert fallback.data == {"from": "proportional_integral", "to": "lqr", "cause": Cause.NO_ANSWER}
    assert not events(run, "brake")


def test_the_demo_ends_at_its_goal_against_the_disturbance(demo: tuple[Any, Any]) -> None:
    result, run = demo
    assert abs(run.traces["disturbance"].value[-1]).max() == 5.0
    assert max(map(abs, result.metrics["final_error"].values())) < 1e-3


def test_a_trial_that_breaks_something_must_say_so() -> None:
    text = DEMO.read_text().replace("allow_faults: true ", "allow_faults: false")
    with pytest.raises(BadInput, match=r"demo: schedule\.3\.fault: .*set allow_faults: true"):
        parse_trial(text, "demo")


def test_the_demo_survives_its_own_text() -> None:
    trial = load_trial(DEMO)
    assert parse_trial(trial_text(trial), "again") == trial


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ("fault: {kind: gremlins}", "gremlins"),
        ("fault: {kind: command_lost, probability: 1.5}", "probability"),
        ("disturbance: {base_yaw: {sine: {amplitude: 1.0}}}", "frequency"),
        ("switch: output_feedback, fault: {kind: command_lost}", "exactly one of switch"),
    ],
)
def test_a_wrong_entry_is_told_in_one_line_with_file_and_key(wrong: str, words: str) -> None:
    text = DEMO.read_text() + f"  - {{at: 80.0, {wrong}}}\n"
    with pytest.raises(BadInput, match=r"demo\.yaml: schedule\.4") as error:
        parse_trial(text, "demo.yaml")
    assert words in str(error.value)
    assert "\n" not in str(error.value)
