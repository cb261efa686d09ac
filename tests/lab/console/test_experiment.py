"""The page's experiment: asked for, heard tick by tick, responses that grow, a model that plans."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.fake_bench import FakeLink
from tests.hands import Hands
from tests.lab.identification.shaken import bench, shaken, truth

from flexslew_control.message_fields import plan_fields
from flexslew_lab.console.link import Iterate, PlanCallback, RequestResult
from flexslew_lab.console.page import Page
from flexslew_lab.console.view import BenchView, Joints
from flexslew_lab.identification.records.measurements import FIELDS
from flexslew_plant.bench.wire import measurement_bytes
from flexslew_plant.graph import topics
from flexslew_plant.graph.topics import TOPICS
from flexslew_plant.measurement import Measurement
from flexslew_plant.testbeds import read_testbed
from flexslew_plant.yaml_data import load_yaml

START, PERIOD = 2.0, 0.02
BENCH = bench(kind="floating_oscillator", damping_ratio=0.02)
PLAN = {
    "band": [0.3, 6.0], "largest_excursion": [0.2], "duration": 100.0, "taper": 2.0,
    "resolution": 0.33,
}  # fmt: skip


class ShakenLink(FakeLink):
    """A bench that is shaken: what its sensors say comes as far as somebody lets it."""

    def __init__(self, folder: str) -> None:
        super().__init__(folder)
        gains = np.array([0.5]), np.array([1.0])
        made = shaken(BENCH, PLAN, gains, np.random.default_rng(5), period=PERIOD)
        assert made.plan is not None
        self.record, self.shakes = made.record, replace(made.plan, start=START)
        model = BENCH.model()
        self.view.joints = Joints(
            "floating_oscillator", model.joint_names, model.joint_units, model.appendages.names,
            tuple(BENCH.effort_limit), PERIOD,
        )  # fmt: skip
        self.view.testbed = BENCH
        self._heard = 0

    def draft(
        self, request: str, who: str, told: Callable[[Iterate], None], then: PlanCallback
    ) -> None:
        self.request.append(("draft_plan", {"request": request, "who": who}))
        shakes = load_yaml(request, "")["method"] == "excitation"
        message = SimpleNamespace(**plan_fields(self.shakes))
        then(RequestResult(True, "drafted"), message if shakes else None)

    def receive(self, until: float) -> None:
        """Let the sensors speak until a simulated time [s], where somebody listens."""
        rows = slice(self._heard, round((until - START) / PERIOD) + 1)
        time = START + PERIOD * np.arange(len(self.record.measured), dtype=float)
        applied = np.vstack((np.zeros((1, 1)), self.record.effort))
        m = self.record.measured
        columns = dict(zip(FIELDS, (m[:, :1], m[:, 1:2], m[:, 2:], applied), strict=True))
        if self.measures:
            self.view.measured.add(time[rows], {k: v[rows] for k, v in columns.items()})
        self._heard, self.view.time = rows.stop, until


@pytest.fixture
def hands(tmp_path: Path) -> Iterator[Hands]:
    page = Page(
        link := ShakenLink(str(tmp_path)), "127.0.0.1", 0, print, layouts=tmp_path / "layouts.json"
    )
    found = Hands(page, link)
    found.refresh()
    yield found
    page.close()


def worked(hands: Hands) -> None:
    """Wait until the worker of the panel has done what it was asked for, and show it."""
    panel: Any = next(p for p in hands.page._panels if type(p).__name__ == "ExperimentPanel")
    panel._worker.submit(lambda: None).result()
    hands.refresh()
    hands.refresh()


def choose(hands: Hands, key: str, text: str) -> str:
    """Write into a field of the experiment, which stands before the plan's, and return the old."""
    field = hands.elements(key)[0]
    before, field.value = str(field.value), text
    return before


def flying(hands: Hands) -> ShakenLink:
    """Plan the experiment and fly it."""
    link = hands.link
    assert isinstance(link, ShakenLink)
    choose(hands, "start", str(START))
    [(_, asked)] = hands.click("Plan the experiment")
    assert load_yaml(asked["request"], "")["start"] == START
    assert link.measures  # before it flies: no tick may be missed
    [(service, values)] = hands.click("Fly the experiment")
    assert (service, values["action"].split()[0]) == ("decide_plan", "adopt")
    link.view.plan = SimpleNamespace(**plan_fields(link.shakes))
    hands.refresh()
    return link


def test_the_form_has_every_key_of_an_excitation_and_refuses_what_it_refuses(hands: Hands) -> None:
    for key, text, words in (
        ("start", "", "start: is missing; the bench is at 0.00 s"),
        ("start", "-1", "start: -1.0 is not allowed"),
        ("band", "[3.0]", "band"),
        ("signal", "noise", "signal"),
        ("taper", "-1.0", "taper: -1.0 is not allowed"),
    ):
        choose(hands, "start", str(START))
        before = choose(hands, key, text)
        assert hands.click("Plan the experiment") == []
        assert words in hands.texts()
        choose(hands, key, before)
    assert not hands.link.measures


def test_responses_grow_with_the_periods_and_the_model_that_is_accepted_plans(
    hands: Hands, tmp_path: Path
) -> None:
    link = flying(hands)
    link.receive(START + 30.0)
    hands.refresh()
    assert "responses show from" in hands.texts()
    assert not any("periods" in title for title in hands.titles())
    seen = []
    for until in (64.0, 84.0, 101.0):
        link.receive(START + until)
        hands.refresh()
        worked(hands)
        seen += [title for title in hands.titles() if title.startswith("|position.mass|")]
    assert seen == [f"|position.mass| [m per N], frequency [rad/s], {n} periods" for n in (2, 3, 4)]
    assert hands.click("Accept the model") == []
    assert "identify the bench first" in hands.texts()
    hands.click("Identify")
    worked(hands)
    (w,), _, _ = truth(BENCH)
    assert "1 mode found" in hands.texts(), hands.texts()[-900:]
    hands.click("Accept the model")
    written = load_yaml((tmp_path / "identified.yaml").read_text(), "")
    assert written["modes"][0]["frequency"]["value"] == pytest.approx(w, rel=2e-3)
    hands.set("Method", "start_coast_stop")
    hands.set("start", str(START + 120.0))
    hands.set("goal of mass", "1.0")
    believed = load_yaml(hands.click("Plan")[0][1]["request"], "")["model"]
    assert believed == written["model"]
    assert read_testbed(believed, "here").kind == "identified"
    hands.set("Believe the identified model", False)
    assert "model" not in load_yaml(hands.click("Plan")[0][1]["request"], "")
    hands.set("Believe the identified model", True)
    link.view.bench_settings = "of another bench that came"
    assert "model" not in load_yaml(hands.click("Plan")[0][1]["request"], "")


def test_a_page_that_came_too_late_says_where_the_ticks_are(hands: Hands) -> None:
    link = hands.link
    assert isinstance(link, ShakenLink)
    link.receive(START + 10.0)  # nobody listens
    hands.click("Identify")
    assert "no experiment was flown yet" in hands.texts()
    link.view.plan = SimpleNamespace(**plan_fields(link.shakes))
    hands.refresh()
    link.receive(START + 60.0)
    hands.click("Identify")
    assert "has not received every tick of the experiment: ./flexslew identify" in hands.texts()


@pytest.mark.parametrize("batch", [1, 3, 100])
def test_a_repeated_question_is_one_row_and_a_reset_begins_anew(batch: int) -> None:
    one = np.zeros(1)

    def asked(tick: int, value: float) -> bytes:
        question = Measurement(
            tick, 0, tick * PERIOD, "pd", np.array([value]), one, one, one, np.zeros(0)
        )
        return measurement_bytes(question)

    ticks = [0, 1, 1, 1, 2, 3, 3, 4]
    view, kind = BenchView(), TOPICS[topics.MEASUREMENT].type
    for first in range(0, len(ticks), batch):
        rows = [asked(tick, 0.1 * tick) for tick in ticks[first : first + batch]]
        view.take(topics.MEASUREMENT, kind, rows)
    assert view.measured.time == pytest.approx(PERIOD * np.arange(5), abs=1e-9)
    assert view.measured.column("joint_position")[:, 0] == pytest.approx(0.1 * np.arange(5))
    view.take(topics.MEASUREMENT, kind, [asked(5, 0.5), asked(0, 7.0), asked(0, 7.0)])
    assert view.measured.column("joint_position").tolist() == [[7.0]]
