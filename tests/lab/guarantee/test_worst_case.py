"""`analyse --guarantee`: bounds of shipped loops enclose the truth, which flights confirm."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat
from tests.present import present
from typer.testing import CliRunner

import flexslew as fs
from flexslew_control.analysis.linear_plant import sampled_plant
from flexslew_lab.analysis.analysis import Analysis, loop_analysis
from flexslew_lab.analysis.page import analysis_page
from flexslew_lab.cli.main import app
from flexslew_lab.guarantee.bounds import worst_case_of
from flexslew_lab.guarantee.flight import guarantee_of
from flexslew_lab.guarantee.model.parameters import Vary, box_of
from flexslew_lab.guarantee.model.varied_loop import varied_loop
from flexslew_lab.guarantee.tables import worst_case_sections
from flexslew_lab.notebook import trial
from flexslew_plant.errors import BadInput

STIFFNESS = "testbed.parameters.stiffness"
RANGE = {STIFFNESS: [0.5, 2.0]}  # of the benchmark of Wie and Bernstein
PLENTY = 3600.0  # processor time that no machine needs [s]


@pytest.fixture(scope="module")
def plain() -> Analysis:
    return loop_analysis(trial("acc_benchmark"), "here", "plain", 0.0)


def test_the_robust_design_is_certified_in_the_published_range() -> None:
    found = fs.worst_case("acc_benchmark", RANGE, "robust", at=0.0, seconds=PLENTY)
    assert found.guaranteed
    assert found.gap < 0.05
    assert all(gain.found <= gain.bound < 1.05 * gain.found for gain in found.gains)


def test_the_plain_design_is_refuted_at_the_right_value(plain: Analysis) -> None:
    found = worst_case_of(trial("acc_benchmark"), plain, RANGE, PLENTY, ())
    assert not found.guaranteed
    unstable = present(found.unstable)
    assert unstable.values[0] == pytest.approx(0.584, abs=0.001)
    assert found.gap < 0.05
    # the truth on a grid of 0.1 %: every loop in the certified range is stable
    varied = varied_loop(trial("acc_benchmark"), plain, RANGE)
    box = box_of(found.parameters)
    grid = np.linspace(-1.0, 1.0, 400)[:, None] * found.certified
    assert all(varied.stable(box.at(delta)) for delta in grid)
    assert not varied.stable(unstable.values)


def test_two_parameters_are_enclosed_by_a_grid(plain: Analysis) -> None:
    vary: Vary = {STIFFNESS: [0.7, 1.8], "gain": 0.3}
    found = worst_case_of(trial("acc_benchmark"), plain, vary, PLENTY, ())
    assert found.certified > 0.0
    assert found.gap < 0.05
    varied, box = varied_loop(trial("acc_benchmark"), plain, vary), box_of(found.parameters)
    points = [np.array([x, y]) for x in np.linspace(-1, 1, 21) for y in np.linspace(-1, 1, 21)]
    assert all(varied.stable(box.at(found.certified * delta)) for delta in points)
    assert not varied.stable(present(found.unstable).values)


@pytest.mark.slow
def test_six_parameters_are_bounded_within_ten_per_cent() -> None:
    near = dict.fromkeys(("driven_mass", "free_mass"), 0.03)
    vary: Vary = {
        STIFFNESS: [0.5, 2.0], "gain": 0.03, "delay": [0.001, 0.015],
        "testbed.damping_ratio": [0.001, 0.01],
        **{f"testbed.parameters.{key}": share for key, share in near.items()},
    }  # fmt: skip
    analysis = loop_analysis(trial("acc_benchmark"), "here", "robust", 0.0)
    found = worst_case_of(trial("acc_benchmark"), analysis, vary, PLENTY, ())
    assert found.certified > 0.0
    assert found.unstable is None or found.gap < 0.1


def test_the_nearest_unstable_loop_is_flown(plain: Analysis) -> None:
    guarantee = guarantee_of(trial("acc_benchmark"), plain, RANGE, fly=True)
    flown = present(guarantee.flown)
    assert flown.agrees
    assert flown.inside < 0.0 < flown.outside
    assert flown.frequency == pytest.approx(guarantee.found.frequency, rel=0.01)
    page = analysis_page(plain, "it", more=worst_case_sections(guarantee))
    for title in ("Guarantee", "Structured singular value", "Worst-case band"):
        assert title in page


def test_the_command_reports_the_guarantee() -> None:
    arguments = ["analyse", "acc_benchmark", "--at", "0", "--guarantee", "--json"]
    done = CliRunner().invoke(app, [*arguments, "--vary", f"{STIFFNESS}=0.6..1.9"])
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)["guarantee"]
    assert found["guaranteed"]
    assert found["checked_points"] > 0
    assert found["verdict"].startswith("stable for every")
    refused = CliRunner().invoke(app, ["analyse", "acc_benchmark", "--vary", "stiffness=20%"])
    assert isinstance(refused.exception, BadInput)


@pytest.mark.parametrize(
    ("vary", "words"),
    [
        ({"stifness": 0.2}, "no parameter"),
        ({"stiffness": 1.2}, "between 0 and 1"),
        ({"stiffness": [1.2, 0.8]}, "low end below high end"),
        ({"stiffness": [1.0]}, "two ends"),
        ({"testbed.parameters.nothing": 0.1}, "no number"),
        ({"delay": 0.1}, "two ends"),
        ({"delay": [0.0, 0.05]}, "whole ticks"),
        ({}, "at least one"),
    ],
)
def test_what_is_not_understood_is_refused(
    plain: Analysis, vary: dict[str, float | str | list[float | str]], words: str
) -> None:
    with pytest.raises(BadInput, match=words):
        worst_case_of(trial("acc_benchmark"), plain, vary)


def test_a_guarantee_without_time_keeps_what_it_has(plain: Analysis) -> None:
    found = worst_case_of(trial("acc_benchmark"), plain, RANGE, seconds=0.0)
    assert not found.guaranteed
    assert found.gains == ()
    assert found.verdict.startswith("not certified: no time")


@pytest.mark.parametrize(("name", "exact"), [("gain", True), ("stiffness", False)])
def test_a_fit_is_exact_where_the_loop_is_affine(plain: Analysis, name: str, exact: bool) -> None:
    found = worst_case_of(trial("acc_benchmark"), plain, {name: 0.1}, 0.0, ())
    assert found.fit.exact is exact
    assert found.fit.words.startswith("exact" if exact else "largest error")
    model = fs.uncertain_model("acc_benchmark", {name: 0.1})
    assert repr(model).endswith("exact>") is exact


def test_an_uncertain_model_is_the_sampled_plant_at_every_value(tmp_path: Path) -> None:
    model = fs.uncertain_model("acc_benchmark", RANGE)
    changed = trial("acc_benchmark", {STIFFNESS: 0.8})
    analysis = loop_analysis(changed, "here", "robust", 0.0)
    plant = sampled_plant(analysis.point.rest, analysis.point.path, applied=True)
    there = model.at(testbed_parameters_stiffness=0.8)
    for name in "abcd":
        np.testing.assert_allclose(getattr(there, name), getattr(plant, name), atol=1e-7)
    assert model.system.nstates == len(plant.a)
    model.save(tmp_path / "plant.mat")
    kept = loadmat(tmp_path / "plant.mat")
    assert kept["blk"][0].tolist() == [-model.form.sizes[0], 0.0]
    with pytest.raises(BadInput, match=r"ends in \.mat"):
        model.save(tmp_path / "plant.txt")
