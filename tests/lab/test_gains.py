"""Gains found by the bench: what a search finds is what a grid finds, and it can go on."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import flexslew as fs
from flexslew_lab.analysis.analysis import loop_analysis
from flexslew_lab.cli.main import app
from flexslew_lab.gains.ensemble import GainEnsemble, Gains, gains_of
from flexslew_lab.gains.page import gains_page
from flexslew_lab.gains.search import search_gains
from flexslew_lab.notebook import fly, trial
from flexslew_lab.trial.trial import Trial
from flexslew_plant.errors import BadInput

KEYS: dict[str, Any] = {
    "testbed.modes": 1,
    "duration": 40.0,
    "period": 0.02,
    "plan": {"method": "reference_only", "goal": {"base_yaw": 0.5, "hub_pitch": 0.2},
             "duration": 20.0},
}  # fmt: skip


@pytest.fixture(scope="module")
def bench() -> tuple[Trial, Gains, GainEnsemble]:
    what = trial("m1", KEYS)
    gains = gains_of(what, "here", None)
    return what, gains, GainEnsemble(what, "here", gains)


@pytest.mark.slow
def test_figures_are_those_of_flights_and_of_the_analysis(
    bench: tuple[Trial, Gains, GainEnsemble],
) -> None:
    what, gains, ensemble = bench
    (outcome,) = ensemble.outcomes([(1.5, 0.8)])
    changed = trial("m1", {**KEYS, "controllers": {"pd_feedforward": gains.times((1.5, 0.8))}})
    alpha = loop_analysis(changed, "here", at=changed.duration).disks["input"].alpha
    assert outcome.alpha == pytest.approx(alpha, rel=1e-12)
    worst = 0.0
    for stiffness in (0.8, 1.2):
        for payload in (0.8, 1.2):
            other: Any = what.testbed.scaled(stiffness, payload)
            size = {**KEYS, "controllers": changed.controllers,
                    "testbed.parameters.bending_stiffness": other.parameters.bending_stiffness,
                    "testbed.parameters.hub_inertia_1": other.parameters.hub_inertia_1,
                    "testbed.parameters.hub_inertia_2": other.parameters.hub_inertia_2}  # fmt: skip
            flight = fly(trial("m1", size))
            worst = max(worst, abs(flight["tip"][flight.time >= 20.0]).max())
    assert outcome.residual >= worst * (1.0 - 1e-6)  # of nine benches, these are four


@pytest.mark.slow
def test_a_search_is_within_2_percent_of_a_grid_and_keeps_the_margin(
    bench: tuple[Trial, Gains, GainEnsemble],
) -> None:
    _, gains, ensemble = bench
    found = search_gains(ensemble, gains, trials=48, octaves=1.0)
    assert found.best.outcome.alpha >= found.shipped.alpha * (1.0 - 1e-9)
    axis = 2.0 ** np.linspace(-1.0, 1.0, 7)
    grid = ensemble.outcomes([(a, b) for a in axis for b in axis])
    best = min(o.residual for o in grid if o.alpha >= found.least * (1.0 - 1e-9))
    assert found.best.outcome.residual <= 1.02 * best
    assert found.gain == pytest.approx(1.0 - found.best.outcome.residual / found.shipped.residual)
    margins = [one.outcome.alpha for one in found.front]
    assert margins == sorted(margins, reverse=True)
    page = gains_page(found, "it")
    assert "% less" in page
    assert "What the margin costs" in page


@pytest.mark.slow
def test_a_search_goes_on_from_its_journal(
    bench: tuple[Trial, Gains, GainEnsemble], tmp_path: Path
) -> None:
    _, gains, ensemble = bench
    journal = tmp_path / "gains.log"
    first = search_gains(ensemble, gains, trials=8, journal=journal)
    counts: list[int] = []
    more = search_gains(
        ensemble, gains, trials=16, journal=journal, progress=lambda done, last: counts.append(done)
    )
    assert counts == [16]
    assert more.tried[:8] == first.tried
    with pytest.raises(BadInput, match="of another search"):
        search_gains(ensemble, gains, trials=16, least=0.1, journal=journal)
    journal.write_text("no journal\n")
    with pytest.raises(BadInput, match="no journal of a search"):
        search_gains(ensemble, gains, trials=8, journal=journal)


def test_gains_whose_loop_is_not_stable_are_not_flown(
    bench: tuple[Trial, Gains, GainEnsemble],
) -> None:
    _, _, ensemble = bench
    (outcome,) = ensemble.outcomes([(2.0**12, 2.0**12)])
    assert outcome.alpha == 0.0
    assert np.isnan(outcome.residual)


@pytest.mark.parametrize(
    ("keys", "options", "words"),
    [
        ({}, {"controller": "none_such"}, "is not in controllers"),
        ({"plan": None}, {}, "there is no manoeuvre"),
        ({}, {"keys": ("kq",)}, "positive numbers of pd_feedforward: kp, kd"),
    ],
)
def test_what_cannot_be_sought_is_refused(
    keys: dict[str, Any], options: dict[str, Any], words: str
) -> None:
    with pytest.raises(BadInput, match=words):
        gains_of(trial("m1", {**KEYS, **keys}), "here", **{"controller": None, **options})


@pytest.mark.slow
def test_a_turn_that_bends_nothing_has_no_gains_to_find() -> None:
    turn = {"method": "none", "goal": {"axis": [0.0, 0.0, 1.0], "angle": 0.05}}
    with pytest.raises(BadInput, match=r"^plan: no tip rings after this manoeuvre"):
        fs.gains(fs.trial("three_axes", {"duration": 2.0, "plan": turn}))


def test_the_command_shows_it_as_json(tmp_path: Path) -> None:
    sets = ["--set=testbed.modes=1", "--set=duration=30", "--set=period=0.02"]
    out = tmp_path / "page.html"
    done = CliRunner().invoke(
        app, ["gains", "m1", *sets, "--trials", "8", "--json", "--out", str(out)]
    )
    assert done.exit_code in (0, 1), done.output
    found = json.loads(done.stdout)
    assert found["trials"] == 8
    assert set(found["best"]["gains"]) == {"kp", "kd"}
    assert out.exists()
