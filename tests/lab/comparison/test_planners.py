import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.representatives import representatives

from flexslew_control.planners import PLANNERS
from flexslew_lab.comparison.comparison import CARRIED, STIFFNESS, compare_candidates
from flexslew_lab.comparison.page import comparison_page
from flexslew_lab.comparison.planners import planners
from flexslew_lab.comparison.slew import slew_comparison, worst_residual
from flexslew_lab.notebook import fly, trial
from flexslew_lab.report.page import write_page
from flexslew_lab.trial.sources import trial_path
from flexslew_lab.trial.trial import load_trial, parse_trial
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import plain

YAW = """
name: yaw
duration: 60.0
period: 0.05
testbed: {kind: csa, modes: 1}
plan: {method: optimized_feedforward, goal: {base_yaw: 1.0, hub_pitch: 0.0}}
"""
HUB = trial_path("time_optimal_hub")


@pytest.fixture(scope="module")
def yaw() -> Any:
    heard = []
    described = planners(parse_trial(YAW, "yaw.yaml"), "yaw.yaml", (-0.2, 0.0))
    found = compare_candidates(described, lambda *at: heard.append(at))
    assert [done for done, _ in heard] == list(range(1, len(heard) + 1))
    assert heard[-1][0] == heard[-1][1] > 4 * len(found.simulated_entries)  # the plans, too
    assert all(last >= heard[-1][1] for _, last in heard)
    return found


@pytest.mark.slow
def test_every_method_flies_the_same_yaw_slew(yaw: Any) -> None:
    flown = {entry.name: entry for entry in yaw.simulated_entries}
    slews = {name for name, entry in PLANNERS.items() if entry.slews}
    assert {name.partition(",")[0] for name in flown} == slews
    variants = {f"{name}, {v.name}" for name, entry in PLANNERS.items() for v in entry.variants}
    assert slews <= set(flown) <= slews | variants
    assert next(iter(flown)) == "optimized_feedforward"
    assert not [entry for entry in yaw.entries if entry.refused]
    for entry in flown.values():
        np.testing.assert_allclose(entry.plan.position[-1], [1.0, 0.0], atol=1e-6)
        assert [flight.stiffness for flight in entry.by(STIFFNESS)] == [-0.2, 0.0]
        assert [flight.carried for flight in entry.by(CARRIED)] == [-0.2, 0.0, 0.2]
        assert max(entry.nominal.metrics["peak_effort"]) <= 150.0


@pytest.mark.slow
def test_no_row_of_a_method_is_there_twice(yaw: Any) -> None:
    plans = [(e.name.partition(",")[0], e.plan.position.tobytes(), e.plan.effort.tobytes(),
              e.plan.gains.tobytes()) for e in yaw.simulated_entries]  # fmt: skip
    assert len(set(plans)) == len(plans) > len(PLANNERS) // 2


def test_the_rigid_body_is_the_lower_bound(yaw: Any) -> None:
    limits = slew_comparison(parse_trial(YAW, "yaw.yaml"), yaw.entries, (-0.2, 0.0))
    assert limits.lower_bound == pytest.approx(2.0 * np.sqrt((4000.0 + 3972.0) / 150.0))
    planned = [entry.plan.duration for entry in yaw.simulated_entries if entry.plan.duration > 0.0]
    assert min(planned) > limits.lower_bound


def test_feedforward_is_worth_something_and_robust_is_robust(yaw: Any) -> None:
    rows = {row["method"]: row for row in yaw.rows()}
    assert rows["optimized_feedforward"]["residual_tip"] < 0.02
    assert rows["reference_only"]["residual_tip"] > 1.0
    worst = {name: row["worst_residual_tip"] for name, row in rows.items()}
    assert worst["robust_feedforward"] < worst["optimized_feedforward"] / 2.0
    with_payload = rows["robust_feedforward, payload"]["residual_tip_by_payload"]
    assert max(with_payload.values()) < max(
        rows["optimized_feedforward"]["residual_tip_by_payload"].values()
    )
    longer = rows["robust_feedforward, 1.2 x time"]
    assert longer["duration"] == 1.2 * rows["optimized_feedforward"]["duration"]
    assert longer["worst_residual_tip"] < worst["robust_feedforward"]
    assert rows["robust_feedforward"]["duration"] == rows["optimized_feedforward"]["duration"]
    assert worst["time_optimal, robust"] < worst["time_optimal"]
    assert worst["input_shaping, zvd"] < worst["input_shaping"]


def test_a_slew_that_never_settles_has_no_settling_time() -> None:
    ringing = YAW + "controllers: {pd_feedforward: {kp: [460.0, 460.0], kd: [0.0, 0.0]}}\n"
    described = planners(parse_trial(ringing, "yaw.yaml"), "yaw.yaml", (0.0,))
    step = [c for c in described.candidates if c.method == "none"]
    found = compare_candidates(replace(described, candidates=step, benches=described.benches[:1]))
    assert (
        found.simulated_entries[0].nominal.metrics["overshoot"]["base_yaw"] > 0.5
    )  # nobody takes it out
    assert found.simulated_entries[0].nominal.metrics["settling_time"] is None


@pytest.mark.slow
@pytest.mark.parametrize("name", representatives(["own_spacecraft", "three_axes"], "three_axes"))
def test_slews_of_a_spacecraft_are_compared_by_its_joints(name: str) -> None:
    described = planners(load_trial(trial_path(name)), name, (0.0,))
    step = [c for c in described.candidates if c.method == "none"]
    found = compare_candidates(replace(described, candidates=step, benches=described.benches[:1]))
    (row,) = found.rows()
    goal = plain(described.trial.plan)["goal"]
    flight = fly(trial(name, {"plan": {"method": "none", "goal": goal}, "duration": 40.0}))
    times = flight.metrics["settling_time"].values()
    assert row["settling_time"] == pytest.approx(max(times))
    assert row["overshoot"] == pytest.approx(flight.metrics["overshoot"])
    left = flight.metrics["residual_attitude_error"].values()  # a step ends at its start
    assert row["residual_joint"] == pytest.approx(max(left))
    assert row["over_lower_bound"] is None  # its axes and wheels take part in the turn
    assert "rigid body" not in found.words
    json.dumps(row)


@pytest.mark.slow
def test_another_testbed_says_what_does_not_apply(tmp_path: Path) -> None:
    hub = replace(load_trial(HUB), period=0.02)
    found = compare_candidates(planners(hub, "hub.yaml", (0.0, 0.1)))
    page = write_page(comparison_page(found), tmp_path / "deep" / "hub.html")
    text = page.read_text(encoding="utf-8")
    assert "Not flown" in text
    assert text.count("data-panels=") == 3
    assert "<script src" not in text  # nothing to fetch
    assert "<link" not in text
    refused = {entry.name: entry.refused for entry in found.entries if not entry.flights}
    assert "payload" in refused["robust_feedforward, payload"]
    assert {"time_optimal", "time_optimal, robust", "reference_only"} <= {
        entry.name for entry in found.simulated_entries
    }
    assert all("\n" not in entry.refused for entry in found.entries)


def test_what_cannot_be_compared_is_said_in_one_line(tmp_path: Path) -> None:
    asked = parse_trial(YAW, "yaw.yaml")
    with pytest.raises(BadInput, match=r"yaw\.yaml: plan: is missing"):
        planners(replace(asked, plan=None), "yaw.yaml")
    with pytest.raises(BadInput, match="errors"):
        planners(asked, "yaw.yaml", (-1.0,))


def test_the_swing_of_every_joint_is_told(yaw: Any) -> None:
    rows = {row["method"]: row for row in yaw.rows()}
    for row in rows.values():
        assert set(row["overshoot"]) == {"base_yaw", "hub_pitch"}
        assert row["overshoot"]["hub_pitch"] is None  # it has nowhere to go
        assert row["overshoot"]["base_yaw"] >= 0.0
        over = 1.0 + row["overshoot"]["base_yaw"]
        assert row["peak_position"]["base_yaw"] == pytest.approx(over, abs=1e-3)
    assert [name for name, _ in yaw.table(yaw.short)] == [
        entry.name for entry in yaw.simulated_entries
    ]
    titles = [column.title for column in yaw.short]
    assert titles[-2:] == ["base_yaw over [%]", "hub_pitch over [%]"]
    assert [column.title for column in yaw.filled(yaw.short)] == titles[:-1]  # none for hub_pitch


OSCILLATOR = """
name: oscillator
duration: 20.0
period: 0.02
testbed: {kind: floating_oscillator}
plan: {method: time_optimal, goal: {mass: 1.0}, robust: true}
controllers: {pd_feedforward: {kp: [0.5], kd: [1.0]}}
active: pd_feedforward
"""


@pytest.fixture(scope="module")
def oscillator() -> Any:
    return compare_candidates(
        planners(parse_trial(OSCILLATOR, "o.yaml"), "o.yaml", (-0.2, 0.0, 0.2))
    )


@pytest.mark.slow
def test_nothing_is_below_the_convex_optimum_of_a_linear_plant(oscillator: Any) -> None:
    found = slew_comparison(parse_trial(OSCILLATOR, "o.yaml"), oscillator.entries, (-0.2, 0.0, 0.2))
    limit = found.limit
    assert limit is not None
    assert limit.least_time == pytest.approx(4.218, rel=5e-3)
    assert found.lower_bound == pytest.approx(2.0 * np.sqrt(2.0))
    assert list(limit.residual) == sorted(limit.residual, reverse=True)
    for entry in oscillator.simulated_entries:
        if limit.duration[0] < entry.plan.duration < limit.duration[-1]:
            below = np.interp(entry.plan.duration, limit.duration, np.log(limit.residual))
            assert np.log(worst_residual(entry) + 1e-9) > below - 0.05
    words = oscillator.note
    assert "NOT AT" in words
    assert "4.2" in words
    assert "a bound" in comparison_page(oscillator)


def test_where_the_plant_is_not_linear_the_line_says_that_it_is_no_bound(yaw: Any) -> None:
    found = slew_comparison(parse_trial(YAW, "yaw.yaml"), yaw.entries, (-0.2, 0.0))
    assert found.limit is None
    assert "not a bound" in comparison_page(yaw)
    x, y = found.best_found
    assert list(x) == sorted(x)
    assert list(y) == sorted(y, reverse=True)


@pytest.mark.slow
def test_a_variant_that_the_trial_asks_for_has_its_name(oscillator: Any) -> None:
    names = [entry.name for entry in oscillator.entries]
    assert names[:2] == ["time_optimal, robust", "time_optimal"]
    assert len(names) == len(set(names))
    robust, plain_one = oscillator.entries[:2]
    assert robust.plan.request["robust"]
    assert not plain_one.plan.request["robust"]
    rows = {row["method"]: row for row in oscillator.rows()}
    assert rows["time_optimal, robust"]["same_duration"]
    assert not rows["time_optimal"]["same_duration"]
    assert rows["time_optimal"]["over_least_time"] == pytest.approx(1.0, rel=0.02)
