"""No number and no failure vanishes: every way of sampling, every criterion, every kind of loss."""

import json
from collections.abc import Callable
from math import inf, nan
from pathlib import Path
from shutil import rmtree
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from tests.panel_numbers import numbers

from flexslew_lab.cli.output.study_results import print_summary
from flexslew_lab.studies.cases import sample_table
from flexslew_lab.studies.findings.criteria import Decision, decide, needed
from flexslew_lab.studies.findings.figures import distribution
from flexslew_lab.studies.findings.page import study_page
from flexslew_lab.studies.findings.population import Population
from flexslew_lab.studies.findings.statistics import (
    dkw_half_width,
    mean_bounds,
    quantile_bounds,
    sign_test,
    success_bounds,
    trials_needed,
)
from flexslew_lab.studies.findings.stopping import interim_sizes, joint_confidence, stop_result
from flexslew_lab.studies.findings.summary import passed, summary
from flexslew_lab.studies.findings.tables import (
    metric_tables,
    pair_rows,
    study_verdict,
    total_rows,
)
from flexslew_lab.studies.flight import FlightResult, failed
from flexslew_lab.studies.store import Store
from flexslew_lab.studies.study import Study
from flexslew_lab.studies.study_settings import Criterion
from flexslew_lab.studies.ways import Way
from flexslew_plant.arrays import Vector

NAME = "residual_tip_deflection"
VARIED = ["testbed.parameters.bending_stiffness", "sensors.joint_velocity.noise"]
SAMPLING: dict[str, dict[str, Any]] = {
    "random": {"n": 60},
    "lhs": {"n": 60},
    "sobol": {"n": 64},
    "grid": {"n": 8},
    "list": {"file": "list.csv"},
    "saltelli": {"n": 16},
}
CRITERIA: dict[str, dict[str, Any]] = {
    "below": {"below": 0.7},
    "above": {"above": 0.2},
    "probably below": {"below": 0.95, "probability": 0.8},
    "probably above": {"above": 0.01, "probability": 0.9, "confidence": 0.95},
    "nearly surely below": {"below": 2.0, "probability": 0.99},
}
LOSSES = ("none", "some failed", "all failed", "some without a number", "both", "not all flown")
INDEPENDENT, REPLICATED = ("random",), ("lhs", "sobol")


def losses(kind: str, rng: np.random.Generator, count: int) -> Vector:
    """Return values between 0 and 1, inf for a failure, NaN for a trial without a number."""
    values = rng.random(count)
    some, others = rng.permutation(count)[: 2 * (count // 10)].reshape(2, -1)
    if kind in ("some failed", "both"):
        values[some] = inf
    if kind in ("some without a number", "both"):
        values[others] = nan
    if kind == "all failed":
        values[:] = inf
    return values


@pytest.fixture
def stored(study_of: Callable[..., Study], tmp_path: Path) -> Callable[..., Any]:
    """Return a function that gives a study with made-up results, and these."""

    def make(method: str, loss: str, criterion: dict[str, Any]) -> tuple[Study, Store, Vector]:
        rng = np.random.default_rng(7)
        rows = [",".join(VARIED), *(f"{k},{k / 1e5}" for k in range(1000, 1050))]
        (tmp_path / "list.csv").write_text("\n".join(rows) + "\n")
        study = study_of(
            sampling={"method": method} | SAMPLING[method],
            compare={"active": ["pd_feedforward", "lqr"]},
            criteria={NAME: criterion},
            **({"vary": None} if method == "list" else {}),
        )
        samples = sample_table(study)
        identity = {
            "study": {"study": study.settings.study},
            "columns": [NAME],
            "variants": [variant.label for variant in study.variants],
            "varied": [varied.name for varied in study.varied],
        }
        store = Store(tmp_path / "store")
        store.create(identity, samples)
        values = losses(loss, rng, 2 * samples.num_rows)
        flown = values[: len(values) // 2] if loss == "not all flown" else values
        store.add(
            [
                failed(k, "lost") if value == inf else result(k, None if value != value else value)
                for k, value in enumerate(flown.tolist())
            ]
        )
        store.write_table()
        return study, store, flown

    return make


def result(number: int, value: float | None) -> FlightResult:
    return FlightResult(number, {NAME: value}, None, "ok", "", Way.BENCH)


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("method", SAMPLING)
def test_counts_add_up_and_bounds_are_claimed_only_where_they_hold(
    stored: Callable[..., Any], method: str, loss: str
) -> None:
    study, store, values = stored(method, loss, CRITERIA["below"])
    found = summary(study, store, {})
    json.dumps(found, allow_nan=False)
    assert found["planned"] == 2 * store.samples.num_rows
    assert found["trials"] == len(values)
    assert found["failed"] == np.isinf(values).sum()
    assert found["reasons"] == ({"lost": found["failed"]} if found["failed"] else {})
    metric = found["metrics"][NAME]
    assert metric["failed"] == np.isinf(values).sum()
    assert metric["missing"] == np.isnan(values).sum()
    for k, variant in enumerate(metric["variants"].values()):
        own = values[k::2]
        there = np.sort(own[~np.isnan(own)])  # failures last
        assert variant["failed"] + variant["missing"] + np.isfinite(own).sum() == len(own)
        if np.isinf(own).any():
            assert variant["mean"] is None
            assert variant["mean_bounds"] == [None, None]
            assert variant["worst"][0]["value"] is None
        else:
            assert variant["mean"] == pytest.approx(there.mean())
        for q, (low, estimate, high) in variant["quantiles"].items():
            expected = there[int(np.ceil(float(q) * len(there))) - 1]
            assert estimate == (expected if np.isfinite(expected) else None)
            if method in INDEPENDENT:
                order = quantile_bounds(there, float(q), 0.95)  # two variants share the error
                assert [low, high] == [v if np.isfinite(v) else None for v in order]
            elif method not in REPLICATED:
                assert low is high is None
            elif estimate is None:
                assert high is None
    for row in found["paired"]:
        pairs = values[: len(values) // 2 * 2].reshape(-1, 2)
        there = ~np.isnan(pairs).any(axis=1)
        one_failed = np.isinf(pairs[there]).sum(axis=1) == 1
        assert (row["pairs"], row["without_number"]) == (there.sum(), (~there).sum())
        assert row["with_failure"] == one_failed.sum()
        larger = np.isinf(pairs[there][:, 1]) & one_failed | (
            pairs[there][:, 1] > pairs[there][:, 0]
        )
        if row["pairs"]:
            assert row["larger"] == pytest.approx(larger.mean())
            assert row["mean"][1] is None or not one_failed.any()
        assert (row["p_value"] is None) == (method not in (*INDEPENDENT, *REPLICATED))
    for row in found["sensitivity"]:
        assert method == "saltelli"
        assert bool(row["why_not"]) == (loss != "none")
    assert bool(found["sensitivity"]) == (method == "saltelli")


@pytest.mark.first(20)
@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize("method", SAMPLING)
def test_what_has_no_number_keeps_to_no_criterion(
    stored: Callable[..., Any], method: str, criterion: str, loss: str
) -> None:
    asked = CRITERIA[criterion]
    study, store, values = stored(method, loss, asked)
    found = summary(study, store, {})
    for k, row in enumerate(found["criteria"]):
        own = values[k::2]
        finite = own[np.isfinite(own)]
        limit = asked.get("below", asked.get("above"))
        kept = int(((finite < limit) if "below" in asked else (finite > limit)).sum())
        assert (row["successes"], row["trials"]) == (kept, len(own))
        assert row["estimate"] == kept / len(own)
        confidence = asked.get("confidence", 0.9)
        if "probability" not in asked:
            assert row["lower_bound"] is None
            whole = "passed" if loss != "not all flown" else "undecided"
            assert row["verdict"] == (whole if kept == len(own) else "refuted")
            continue
        assert row["needed"] == trials_needed(asked["probability"], confidence, len(own) - kept)
        exact, most = success_bounds(kept, len(own), confidence)
        if method in INDEPENDENT:
            assert row["lower_bound"] == exact
            # that many independent trials with these failures show it, and no fewer
            assert row["passed"] == (len(own) >= row["needed"])
            assert (row["verdict"] == "refuted") == (most < asked["probability"])
        elif method in REPLICATED:
            assert 0.0 <= row["lower_bound"] <= exact
            assert most <= row["upper_bound"] <= 1.0
        else:
            assert row["lower_bound"] is row["upper_bound"] is None
            assert row["verdict"] == "undecided"
    assert passed(found) == all(row["passed"] for row in found["criteria"])
    said = needed(study, store.samples)
    assert len(said) == ("probability" in asked)
    if said and method not in (*INDEPENDENT, *REPLICATED):
        assert "show no probability, however many" in said[0]


def test_what_all_trials_must_keep_to_is_undecided_until_all_have_flown(
    told: Callable[..., tuple[Study, Store]],
) -> None:
    """Or until the study has stopped."""
    study, store = told(
        [{NAME: 0.1}] * 3, sampling={"method": "random", "n": 9}, criteria={NAME: {"below": 1.0}}
    )
    for flights, verdict in (({}, "undecided"), ({"stopped": {"samples": 3}}, "passed")):
        found = summary(study, store, flights)
        assert [row["verdict"] for row in found["criteria"]] == [verdict]
        assert passed(found) == (verdict == "passed")


def test_the_terminal_tells_how_many_trials_have_no_number(
    told: Callable[..., tuple[Study, Store]],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("COLUMNS", "200")  # a narrow one folds the name
    study, store = told([{NAME: 0.1}, {NAME: None}, {NAME: None}, None])
    print_summary(summary(study, store, {"wall_time": 1.0, "trials_per_second": 4.0}), False)
    (line,) = (one for one in capsys.readouterr().out.splitlines() if one.strip().startswith(NAME))
    assert line.split()[-2:] == ["1", "2"]  # failed, missing


def test_where_no_pair_has_two_numbers_there_is_no_difference(
    told: Callable[..., tuple[Study, Store]],
) -> None:
    study, store = told(
        [{NAME: 0.1}, {NAME: None}] * 3,
        compare={"active": ["pd_feedforward", "lqr"]},
        sampling={"method": "random", "n": 3},
        criteria={NAME: {"below": 1.0}},
    )
    (row,) = pair_rows(summary(study, store, {}))
    assert (row.mean, row.median) == ("-", "-")  # not "unbounded", as of a number beyond all
    assert row.pairs == "0, 3 without a number left out"


def test_a_study_states_first_what_it_decides(
    told: Callable[..., tuple[Study, Store]], capsys: pytest.CaptureFixture[str]
) -> None:
    limits = {NAME: {"below": 1.0}, "peak_tip_deflection": {"below": 3.0}}
    row = {NAME: 2.0, "peak_tip_deflection": 2.0}
    study, store = told([row] * 3, criteria=limits)
    found = summary(study, store, {"wall_time": 1.0, "trials_per_second": 4.0})
    words = study_verdict(found)
    assert words.startswith("2 criteria: 1 passed, 1 refuted; refuted: ")
    assert f"{NAME} below 1: 0 of 3" in words
    assert words.endswith("; 0 of 3 trials failed")
    print_summary(found, False)
    assert capsys.readouterr().out.startswith(words)
    page = study_page(study, store, found)
    assert page.index("2 criteria: 1 passed") < page.index("<h2>")


def test_129_of_200_refute_a_probability_of_nine_tenths() -> None:
    below = Criterion(below=0.5, probability=0.9, confidence=0.9)
    kept = np.arange(200) < 129
    bound = Population(np.zeros(200)).success(kept, 0.9)
    assert decide(below, kept, bound, 200) is Decision.REJECTED
    for successes, verdict in ((179, Decision.UNKNOWN), (200, Decision.PASSED)):
        kept = np.arange(200) < successes
        bound = Population(np.zeros(200)).success(kept, 0.9)
        assert decide(below, kept, bound, 200) is verdict


@pytest.mark.parametrize("side", ["below", "above"])
def test_a_variant_that_fails_more_often_is_the_worse_one(
    stored: Callable[..., Any], side: str
) -> None:
    """Also where its numbers are the better ones whenever there are some."""
    study, store, _ = stored("random", "none", {side: 0.5})
    rng = np.random.default_rng(1)
    better = -0.5 if side == "below" else 0.5
    rows = []
    for sample in range(60):
        value = float(rng.random())
        rows.append(result(2 * sample, value))
        fails = sample % 3 > 0
        rows.append(
            failed(2 * sample + 1, "lost") if fails else result(2 * sample + 1, value + better)
        )
    store.add(rows)
    store.write_table()
    (row,) = summary(study, store, {})["paired"]
    assert (row["pairs"], row["with_failure"]) == (60, 40)
    assert row["verdict"] == ("larger" if side == "below" else "smaller")
    assert row["p_value"] == pytest.approx(sign_test(40, 20))


@pytest.fixture
def told(study_of: Callable[..., Study], tmp_path: Path) -> Callable[..., tuple[Study, Store]]:
    """Return a function that gives a study with the metrics of its trials; None: it failed."""

    def make(rows: list[dict[str, float | None] | None], **keys: Any) -> tuple[Study, Store]:
        study = study_of(**{"sampling": {"method": "random", "n": len(rows)}, **keys})
        identity = {
            "study": {"study": study.settings.study},
            "columns": list(next(row for row in rows if row is not None)),
            "variants": [variant.label for variant in study.variants],
            "varied": [varied.name for varied in study.varied],
        }
        store = Store(tmp_path / "told")
        store.create(identity, sample_table(study))
        store.add(
            [
                failed(k, "lost")
                if row is None
                else FlightResult(k, row, None, "ok", "", Way.BENCH)
                for k, row in enumerate(rows)
            ]
        )
        store.write_table()
        return study, store

    return make


def test_what_never_happens_is_worse_than_any_number(
    told: Callable[..., tuple[Study, Store]],
) -> None:
    rng = np.random.default_rng(4)
    rows: list[dict[str, float | None] | None] = []
    for k in range(40):
        known: dict[str, float | None] = {"overshoot": None, "overshoot.hub": 0.1}
        known |= {"peak_platform_attitude": 0.2, "line_of_sight_error": 0.3 if k < 30 else None}
        for name in NEVER:
            known |= {name: None if k >= 20 else float(rng.random())}
        rows.append(known)
    study, store = told(rows)
    found = summary(study, store, {})["metrics"]
    for name in NEVER:
        missing = 10 if name == "line_of_sight_settled_at" else 0  # which did not end their turn
        assert (found[name]["failed"], found[name]["missing"]) == (0, missing)
        assert found[name]["mean"] is None
        assert found[name]["quantiles"]["0.9"][1] is None
        assert found[name]["worst"][0] == {"index": 20, "value": None, "failed": False}


def test_bounds_of_paired_differences_hold_for_all_variants_at_once(
    told: Callable[..., tuple[Study, Store]],
) -> None:
    rng = np.random.default_rng(6)
    values = rng.normal(size=(60, 5))
    limits = [100.0, 110.0, 120.0, 130.0, 140.0]
    study, store = told(
        [{NAME: value} for value in values.ravel().tolist()],
        compare={"testbed.effort_limit": [[one, one] for one in limits]},
        sampling={"method": "random", "n": 60},
    )
    rows = summary(study, store, {})["paired"]
    alone = 1.0 - 0.1 / 4  # confidence of each, so that all four hold at once in 90 %
    for k, row in enumerate(rows, start=1):
        difference = values[:, k] - values[:, 0]
        assert (row["mean"][0], row["mean"][2]) == pytest.approx(mean_bounds(difference, alone))
        low, _, high = row["median"]
        assert (low, high) == pytest.approx(quantile_bounds(difference, 0.5, alone))


def test_units_are_those_of_the_joints_of_the_bench(
    told: Callable[..., tuple[Study, Store]],
) -> None:
    rows: list[dict[str, float | None] | None] = [{"peak_effort": 1.0, "goal_error": 0.5}] * 2
    turning = summary(*told(rows), {})["metrics"]
    assert (turning["peak_effort"]["unit"], turning["goal_error"]["unit"]) == ("N m", "-")


NEVER = (
    "settling_time",
    "pointing_settled_at",
    "vibration_settling_time",
    "line_of_sight_settled_at",
)


@pytest.mark.slow
def test_a_study_that_was_interrupted_before_a_variant_flew_has_a_page(
    told: Callable[..., tuple[Study, Store]],
) -> None:
    study, store = told([{NAME: 0.1}], compare={"active": ["pd_feedforward", "lqr"]})
    page = study_page(study, store, summary(study, store, {}))
    assert "1 of 2" in page
    assert "Incomplete; " in page


def test_a_metric_that_no_trial_has_is_in_no_table(
    told: Callable[..., tuple[Study, Store]],
) -> None:
    names = ("settling_time", "overshoot", "largest_effort_step", "goal_error")
    nobody = dict.fromkeys(names)
    rows = [nobody | {NAME: 0.1 * k} for k in range(5)]
    for lost in ([], [None, None]):
        study, store = told([*rows, *lost])
        found = summary(study, store, {})
        (shown,) = metric_tables(found).values()
        assert [row.name for row in shown] == [NAME]
        assert [row.name for row in total_rows(found)] == [NAME]
        rmtree(store.folder)
    study, store = told([*rows, nobody | {NAME: 1.0, "goal_error": 0.1}])
    (shown,) = metric_tables(summary(study, store, {})).values()
    assert [row.name for row in shown] == ["goal_error", NAME]


def test_a_study_looks_for_its_stop_at_the_bounds_that_it_reports(
    told: Callable[..., tuple[Study, Store]],
) -> None:
    rng = np.random.default_rng(3)
    rows = [{NAME: None if k % 3 == 0 else float(rng.random())} for k in range(128)]
    study, store = told(rows, stop={"metric": NAME, "quantile": 0.5, "half_width": 0.5})
    found = stop_result(study, store, store.samples, 128)
    assert found is not None
    reported = summary(study, store, {})["metrics"][NAME]["quantiles"]["0.5"]
    assert found["bounds"] == {"": reported}


def test_bounds_and_criteria_of_a_study_that_may_stop_hold_at_every_look(
    told: Callable[..., tuple[Study, Store]],
) -> None:
    rng = np.random.default_rng(5)
    rows = [{NAME: float(rng.random()), "goal_error": float(rng.random())} for _ in range(128)]
    asked = {"goal_error": {"below": 0.95, "probability": 0.9}}
    stop = {"metric": NAME, "quantile": 0.5, "half_width": 0.5}
    study, store = told(rows, stop=stop, criteria=asked)
    assert interim_sizes(study, store.samples) == [64, 128]
    found = summary(study, store, {})
    values = np.array([row["goal_error"] for row in rows])
    (row,) = found["criteria"]
    kept = int(np.count_nonzero(values < 0.95))
    assert (row["lower_bound"], row["upper_bound"]) == success_bounds(kept, 128, 0.95)
    low, _, high = found["metrics"]["goal_error"]["quantiles"]["0.5"]
    assert (low, high) == quantile_bounds(values, 0.5, 0.95)
    drawn = distribution(study, store, "goal_error", "-", {"": values})
    curve, _, above, _ = (numbers(trace["y"]) for trace in drawn.panels[0].traces)
    assert (above - curve)[:60] == pytest.approx(dkw_half_width(128, 0.95))


def test_a_study_that_stops_errs_no_more_often_than_its_criterion_says(
    study_of: Callable[..., Study],
) -> None:
    """One in 200 trials is far off; the study stops where its 99 % quantile is known."""
    stop = {"metric": NAME, "quantile": 0.99, "half_width": 1.0}
    study = study_of(sampling={"method": "random", "n": 4096}, stop=stop)
    samples = pa.table({"replicate": np.zeros(4096, dtype=np.int32)})
    looks, probability = interim_sizes(study, samples), 0.995
    each, joint = joint_confidence(study, samples, 0.9), 1.0 - 0.1 / len(looks)
    rng, runs, wrong, alone = np.random.default_rng(2), 1500, 0, 0
    for _ in range(runs):
        values = np.where(rng.random(4096) < 1.0 - probability, 10.0, 0.0)
        for n in looks:
            low, high = quantile_bounds(values[:n], 0.99, joint)
            if high - low <= 2.0:
                break
        kept = int(np.count_nonzero(values[:n] < 5.0))
        wrong += success_bounds(kept, n, each)[0] > probability
        alone += success_bounds(kept, n, 0.9)[0] > probability
    assert wrong <= 0.1 * runs
    assert alone > 0.11 * runs  # as bounds for a given number of samples do
