"""The page's analysis: of what flies, tuned as it is; and a law that is loaded from a file."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.fake_bench import FakeLink
from tests.hands import Hands

from flexslew_control.controllers import build_controller, settings_text
from flexslew_lab.analysis.analysis import loop_analysis
from flexslew_lab.analysis.page import summary_rows
from flexslew_lab.console.page import Page
from flexslew_lab.console.view import ControllerView
from flexslew_lab.notebook import trial
from flexslew_lab.trial.trial import bench_settings, law_of, plant_of
from flexslew_plant.settings import plain
from flexslew_plant.yaml_data import load_yaml, yaml_text

FLOWN = trial("m1", {"plan": None, "testbed.modes": 1, "testbed.initial": {"hub_pitch": 0.5}})
TUNED = {"kp": [300.0, 500.0], "kd": [800.0, 950.0]}


def announced(link: FakeLink, name: str, law: str, values: dict[str, Any]) -> None:
    """Let a controller say what it is, as its node does."""
    built = build_controller(name, law, values, plant_of(FLOWN), "here")
    text = settings_text(built, law, values)
    link.view.controllers[name] = ControllerView(name, law, True, "", text)


@pytest.fixture(params=[True, False])
def hands(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Hands]:
    """Yield a page over a bench whose run has a folder, or none that the page knows."""
    link = FakeLink(str(tmp_path) if request.param else "")
    link.view.bench_settings = yaml_text({"bench": plain(bench_settings(FLOWN))})
    link.view.now = link.view.now._replace(state="running", active="pd")
    announced(link, "pd", "pd_feedforward", TUNED)
    announced(link, "linear", "linear", {})
    page = Page(link, "127.0.0.1", 0, print, layouts=tmp_path / "layouts.json")
    found = Hands(page, link)
    found.refresh()
    yield found
    page.close()


def analyse(hands: Hands, button: str = "Analyse") -> str:
    """Return what stands on the page after a click and all that it began."""
    assert hands.click(button) == []
    panel: Any = next(p for p in hands.page._panels if type(p).__name__ == "AnalysePanel")
    panel._worker.submit(lambda: None).result()
    hands.refresh()
    return hands.texts()


@pytest.mark.first(1)
def test_the_page_shows_what_the_command_says_of_the_gains_that_fly(hands: Hands) -> None:
    expected = loop_analysis(replace(FLOWN, controllers={"pd_feedforward": TUNED}), "here", at=0.0)
    texts = analyse(hands)
    for what, value in summary_rows(expected):
        assert f"{what}: {value}" in texts
    assert 'href="/run/analysis.html"' in texts
    page = hands.page.server.gate.files["analysis.html"].read_text().replace("<wbr>", "")
    assert "Nichols" in page
    assert f"{np.degrees(expected.efforts[0].phase):.4g}" in page


BENCHMARK = trial("acc_benchmark", {"plan": None})


@pytest.fixture
def benchmark(tmp_path: Path) -> Iterator[Hands]:
    """Yield a page over a bench with the benchmark's spring, flown by its plain design."""
    link = FakeLink(str(tmp_path))
    link.view.bench_settings = yaml_text({"bench": plain(bench_settings(BENCHMARK))})
    link.view.now = link.view.now._replace(state="running", active="plain")
    law, values = law_of("plain", BENCHMARK.controllers["plain"] or {})
    built = build_controller("plain", law, values, plant_of(BENCHMARK), "here")
    text = settings_text(built, law, values)
    link.view.controllers["plain"] = ControllerView("plain", law, True, "", text)
    page = Page(link, "127.0.0.1", 0, print, layouts=tmp_path / "layouts.json")
    hands = Hands(page, link)
    hands.refresh()
    yield hands
    page.close()


def test_the_nearest_unstable_loop_is_shown_and_flown(benchmark: Hands) -> None:
    benchmark.set("uncertain", "testbed.parameters.stiffness=0.5..2")
    texts = analyse(benchmark, "Guarantee")
    assert "testbed.parameters.stiffness: unstable at 0.584" in texts
    assert "flown as predicted" not in texts
    assert "peak of pointing" in texts
    page = benchmark.page.server.gate.files["analysis.html"].read_text()
    assert "Structured singular value" in page
    assert "Worst-case bands" in page
    assert "flown as predicted" in analyse(benchmark, "Fly it")


def test_ranges_that_are_none_are_refused_in_words(hands: Hands) -> None:
    hands.set("uncertain", "stiffness")
    assert "refused: --vary" in analyse(hands, "Guarantee")
    hands.set("uncertain", "stifness=20%")
    assert "refused: vary: no parameter" in analyse(hands, "Guarantee")
    hands.set("uncertain", "stiffness=0.1%")
    assert "there is none to fly" in analyse(hands, "Fly it")


def settled(hands: Hands) -> str:
    """Return what stands on the page once the margins of all loops are computed."""
    margins = hands.page._context.margins
    hands.refresh()
    while margins._job is not None:
        margins._job[1].exception()
        hands.refresh()
    return hands.texts()


def test_a_card_shows_the_margin_of_its_loop_and_none_where_there_is_no_loop(hands: Hands) -> None:
    expected = loop_analysis(replace(FLOWN, controllers={"pd_feedforward": TUNED}), "here", at=0.0)
    texts = settled(hands)
    assert f"<div>stable, disk margin {expected.disks['input'].alpha:.2f}</div>" in texts
    assert texts.count("disk margin") == 1  # a law without a sensor has none


@pytest.mark.parametrize(
    ("gain", "words"), [("[600.0, 500.0]", "stable, disk margin"), ("[1e7, 1e7]", "not stable")]
)
def test_the_stability_of_new_gains_is_shown_before_they_are_applied(
    hands: Hands, gain: str, words: str
) -> None:
    hands.click("Tune pd")
    texts = settled(hands)
    now = texts[texts.index("Linear loop: stable, disk margin") :][:40]
    hands.set("kp", gain)
    hands.refresh()
    assert "computing ..." in hands.texts()
    texts = settled(hands)
    assert f"Linear loop with these gains: {words}" in texts
    assert now.replace("Linear loop", "Now")[:26] in texts
    hands.set("kp", "[")
    assert "Linear loop" not in settled(hands)
    assert hands.link.request == []  # nothing was applied


def test_what_cannot_be_analysed_is_refused_in_words(hands: Hands) -> None:
    hands.set("analysed at", "-1")
    assert "refused: analysed at: -1.0 is not allowed" in analyse(hands)
    hands.set("analysed at", "57 deg")
    assert "refused: analysed at: &#x27;57 deg&#x27; is not allowed: give a" in analyse(hands)
    hands.set("analysed at", "-2 min")
    assert "refused: analysed at: -120.0 is not allowed" in analyse(hands)
    hands.set("analysed at", "")
    hands.set("Analysed controller", "linear")
    assert "refused: the bench: linear listens to no sensor there" in analyse(hands)
    hands.link.view.bench_settings = ""
    assert "refused: the bench has not published" in analyse(hands)


def test_a_law_is_loaded_from_a_file_and_its_content_is_sent(hands: Hands, tmp_path: Path) -> None:
    hands.click("Tune linear")
    hands.refresh()
    gains = [[400.0, 0.0, 900.0, 0.0], [0.0, 400.0, 0.0, 900.0]]
    np.savez(tmp_path / "law.npz", D=gains)
    for wrong, words in (("nowhere.npz", "cannot be read"), ("law.py", "give a file that ends in")):
        hands.set("file", str(tmp_path / wrong))
        assert hands.click("Apply the gains") == []
        assert words in hands.texts()
    hands.set("file", str(tmp_path / "law.npz"))
    [(service, values)] = hands.click("Apply the gains")
    assert service == "linear/tune"
    sent = load_yaml(values["settings"], "")
    assert set(sent) == {"system"}
    assert sent["system"]["d"] == gains
    assert str(tmp_path) not in values["settings"]


def test_a_law_without_files_has_no_field_for_one(hands: Hands) -> None:
    hands.click("Tune pd")
    hands.refresh()
    assert hands.elements("file") == []
