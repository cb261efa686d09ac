"""An experiment from the page in a real browser: shaken, seen, identified, accepted, planned."""

from pathlib import Path

import pytest

from flexslew_lab.log.bag_reader import BagReader
from flexslew_plant.yaml_data import load_yaml
from tests.browser import chromium

from .console_page import Page, console

_TRIAL = """
name: shaken_by_hand
duration: 2000.0
period: 0.02
testbed: {kind: floating_oscillator, damping_ratio: 0.02}
sensors: {joint_position: {noise: 4.0e-3}, joint_velocity: {noise: 3.0e-3}}
plan: {method: none}
controllers: {pd_feedforward: {kp: [0.5], kd: [1.0]}}
active: pd_feedforward
"""


@pytest.mark.browser
@pytest.mark.alone
@pytest.mark.timeout(600)
def test_a_bench_is_shaken_identified_and_planned_for_from_the_page(tmp_path: Path) -> None:
    trial, run = tmp_path / "shaken.yaml", tmp_path / "run"
    trial.write_text(_TRIAL)
    bench = console(str(trial), "--out", str(run), "--rate", "10")
    with chromium() as browser, bench as (_, address):
        browser.open(address, 1300, 1000, scale=0.25)
        page = Page(browser)
        page.state("paused")
        page.tab("Experiment")
        for field, text in (
            ("band", "[0.3, 6.0]"), ("largest_excursion", "[0.2]"), ("resolution", "0.33"),
            ("taper", "2.0"), ("start", "2.0"), ("duration", "100.0"),
        ):  # fmt: skip
            page.write(field, text)
        page.click("Plan the experiment")
        page.says("excitation: 100 s from 2 s on is drafted")
        page.click("Fly the experiment")
        page.says("flown from 2 s on")
        page.click("Start")
        page.says("5 of 5 periods received")
        page.says("|position.mass| [m per N], frequency [rad/s], 4 periods")
        page.click("Pause")
        page.state("paused")
        page.click("Identify")
        page.says("1 mode found")
        page.says("model, from mass")
        page.click("Accept the model")
        page.says("plans believe it")
        page.tab("Plan")
        page.choose("Method", "start_coast_stop")
        page.write("goal of mass", "0.5")
        page.write("start", "1500.0")
        page.write("duration", "20.0")
        page.click("Plan")
        page.says("start_coast_stop: 20 s from 1500 s on is drafted")
        page.click("Adopt the draft")
        page.says("start_coast_stop: flown from 1500 s on")
        assert not [c for c in browser.complaints() if "Refused" in c]
    found = load_yaml((run / "identified.yaml").read_text(), "")["modes"][0]["frequency"]
    assert found["value"] == pytest.approx(2.0**0.5, rel=5e-3)
    plans = {plan.method: plan for plan in BagReader(run / "bag").overview.plans}
    assert "excitation" in plans
    believed = load_yaml(plans["start_coast_stop"].request, "")["model"]
    assert believed["kind"] == "identified"
