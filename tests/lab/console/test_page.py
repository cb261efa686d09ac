"""The page's fields and buttons: what is asked of the bench, and what is told beside a field."""

from collections.abc import Iterator
from itertools import permutations
from math import inf, nan, pi
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from tests.fake_bench import FakeLink
from tests.hands import Hands, shown
from tests.page_client import PageClient

from flexslew_lab.console import quantities
from flexslew_lab.console.forms import OpenedOn, scaled
from flexslew_lab.console.gui import Gui
from flexslew_lab.console.page import Page
from flexslew_plant.events import AnswerMissing, OperatorNote
from flexslew_plant.events.event import event_of
from flexslew_plant.yaml_data import load_yaml


@pytest.fixture(scope="module")
def hands(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Hands]:
    link, file = FakeLink(), tmp_path_factory.mktemp("page") / "layouts.json"
    page = Page(link, "127.0.0.1", 0, lambda words: None, layouts=file)
    found = Hands(page, link)
    found.refresh()
    yield found
    page.close()


def test_the_run_is_asked_for_by_name_with_who(hands: Hands) -> None:
    for button, action in (
        ("Start", "start"),
        ("Reset", "reset"),
        ("Brake (space bar)", "brake"),
        ("Release the brake", "release_brake"),
    ):
        [(service, values)] = hands.click(button)
        assert (service, values["action"]) == ("operate", action)
        assert values["who"].endswith(", page 3")


@pytest.mark.parametrize("ticks", [0, -3, 1.5, nan, inf, 1e30])
def test_a_step_that_is_none_is_told_and_not_sent(hands: Hands, ticks: float) -> None:
    hands.set("Ticks", ticks)
    assert hands.click("Step") == []
    assert "is not allowed: a whole number from 1" in hands.texts()
    hands.set("Ticks", 7)
    assert hands.click("Step")[0][1]["ticks"] == 7


@pytest.mark.parametrize("rate", ["0.1", "1", "10", "fast"])
def test_rates_are_those_of_the_list(hands: Hands, rate: str) -> None:
    [(service, values)] = hands.change("Rate", rate)
    assert service == "set_rate"
    assert values["rate_factor"] == (0.0 if rate == "fast" else float(rate))
    assert hands.change("Rate", "warp") == []


def test_a_switch_carries_its_limit_and_refuses_a_time_that_is_none(hands: Hands) -> None:
    hands.set("Strict", True)
    hands.set("Largest step", 0.25)
    [(service, values)] = hands.click("Switch to pd")
    assert service == "switch_controller"
    assert (values["controller"], values["strict"], values["max_effort_step"]) == ("pd", True, 0.25)
    for wrong in (-1.0, nan, inf):
        hands.set("At [s]", wrong)
        assert hands.click("Switch to pd") == []
    hands.set("At [s]", 0.0)


@pytest.mark.parametrize(
    ("key", "text", "words"),
    [
        ("kp", "[-1.0, 460.0]", "kp.0: -1.0 is not allowed"),
        ("kp", "[", "kp: line 2, column 1"),
        ("kp", "lots", "kp: &#x27;lots&#x27; is not allowed"),
        ("handover_time", "-1.0", "handover_time: -1.0 is not allowed"),
        ("handover_time", ".inf", "handover_time: inf is not allowed"),
        ("handover_time", "nan", "handover_time: &#x27;nan&#x27; is not allowed: give a finite"),
        ("tuned from", "soon", "tuned from"),
    ],
)
def test_a_wrong_gain_is_told_beside_its_field(
    hands: Hands, key: str, text: str, words: str
) -> None:
    hands.click("Tune pd")
    hands.refresh()
    field = hands.elements(key)[-1]
    before = field.value
    field.value = text
    assert hands.click("Apply the gains") == []
    assert words in hands.texts()
    field.value = before
    assert hands.click("Apply the gains") == []
    assert "nothing has changed" in hands.texts()


def test_only_what_has_changed_is_tuned(hands: Hands) -> None:
    hands.click("Tune pd")
    hands.refresh()
    hands.set("kd", "[900.0, 900.0]")
    [(service, values)] = hands.click("Apply the gains")
    assert service == "pd/tune"
    assert load_yaml(values["settings"], "") == {"kd": [900.0, 900.0]}
    hands.set("kd", "[920.0, 920.0]")


def test_disturbances_are_made_from_their_schema(hands: Hands) -> None:
    sine, pulse = {"amplitude": 3, "frequency": 0.5}, {"amplitude": 3, "width": 0.2}
    for shape, fields, expected in (
        ("constant", {"constant effort": "5"}, 5),
        ("sine", {"amplitude": "3", "frequency": "0.5"}, {"sine": {**sine, "phase": 0.0}}),
        ("pulse", {"amplitude": "3", "width": "0.2"}, {"pulse": pulse}),
    ):
        hands.set("Disturbance", shape)
        hands.refresh()
        for name, text in fields.items():
            hands.set(name, text)
        [(service, values)] = hands.click("Disturb")
        assert service == "inject_fault"
        entry = load_yaml(values["fault"], "")["disturbance"]["a"]
        assert entry == expected
    hands.set("frequency" if hands.elements("frequency") else "width", "-1")
    assert hands.click("Disturb") == []
    assert "width: -1 is not allowed" in hands.texts()


def test_every_fault_has_a_form_that_the_bench_can_read(hands: Hands) -> None:
    from flexslew_plant.faults import FAULTS

    for kind in FAULTS:
        hands.set("Fault", kind)
        hands.refresh()
        for name, text in (("gain", "0.5"), ("ticks", "2"), ("bias", "0.1")):
            if hands.elements(name):
                hands.set(name, text)
        [(service, values)] = hands.click("Break")
        fault = load_yaml(values["fault"], "")["fault"]
        assert (service, fault["kind"]) == ("inject_fault", kind)


def test_a_plan_needs_a_start_to_come(hands: Hands) -> None:
    hands.set("goal of a", "0.5")
    assert hands.click("Plan") == []
    assert "start: is missing" in hands.texts()
    hands.set("start", "12.0")
    hands.set("duration", "-1")
    assert hands.click("Plan") == []
    assert "duration: -1 is not allowed" in hands.texts()
    hands.set("duration", "20")
    [(service, values)] = hands.click("Plan")
    assert service == "draft_plan"
    request = load_yaml(values["request"], "")
    assert (request["goal"], request["start"]) == ({"a": 0.5, "b": 0.0}, 12.0)
    assert "1: J 5.0000e-01" in hands.texts()


def test_every_wrong_field_of_a_plan_is_marked_at_once(hands: Hands) -> None:
    wrong = {"goal of a": "1e9", "goal of b": "2 min", "duration": "-1", "start": "soon"}
    for field, text in {**wrong, "more": "["}.items():
        hands.set(field, text)
    assert hands.click("Plan") == []
    for field in (*wrong, "more"):
        assert f'role="alert" class="bench-note">{field}: ' in hands.texts(), field
    for field in (*wrong, "more"):
        hands.change(field, "")
        assert f'role="alert" class="bench-note">{field}: ' not in hands.texts()
    hands.set("start", "")
    hands.set("goal of a", "0.5")
    hands.set("goal of b", "0.0")


def test_a_button_writes_a_start_five_seconds_from_now(hands: Hands) -> None:
    hands.link.view.time = 12.3
    hands.click("In 5 s")
    assert hands.elements("start")[-1].value == "18"
    hands.link.view.time = 0.0


def test_a_planner_of_ones_own_is_asked_of_the_planner_and_not_run_by_the_page(
    hands: Hands,
) -> None:
    method = "not_here.py:Shaper"
    hands.set("start", "12.0")
    hands.set("duration", "20")
    hands.set("more", f"{{method: '{method}', waits: 2}}")
    [(_, values)] = hands.click("Plan")
    request = load_yaml(values["request"], "")
    assert (request["method"], request["waits"]) == (method, 2)
    hands.set("more", "")


@pytest.mark.parametrize(
    ("button", "word"), [("Adopt the draft", "adopt"), ("Refuse the draft", "refuse")]
)
def test_a_draft_is_drawn_and_waits_for_a_decision(hands: Hands, button: str, word: str) -> None:
    hands.set("start", "12.0")
    hands.click("Refuse the draft")  # of an earlier test
    assert hands.click(button) == []
    assert "there is no draft to decide on" in hands.texts()
    assert hands.click("Plan")
    hands.refresh()
    assert hands.elements(button)[0].visible
    title = "time [s]; draft, not flown: reference_only, from 12 s on"
    assert title in hands.titles()
    [draft] = [c for c in hands.charts() if c.data.options["title"]["text"] == title]
    assert draft.data.options["legend"]["data"] == ["planned a [rad]", "planned b [m]"]
    assert "largest effort: a 3 N m, b 4 N" in hands.texts()
    assert "predicted residual: tip deflection 0.0037 m" in hands.texts()
    [(service, values)] = hands.click(button)
    assert (service, values["action"]) == ("decide_plan", f"{word} {'d' * 64}")
    assert not hands.elements(button)[0].visible
    assert title not in hands.titles()


def test_a_remark_must_say_something(hands: Hands) -> None:
    hands.set("Remark", "  ")
    assert hands.click("Note it") == []
    hands.set("Remark", "<b>it rings</b>")
    [(service, values)] = hands.click("Note it")
    assert (service, values["text"]) == ("note", "<b>it rings</b>")


def test_a_chart_shows_its_window_and_a_dashed_reference(hands: Hands) -> None:
    view, time = hands.link.view, np.arange(500, dtype=float) * 0.01
    rows = 2e-6 * np.column_stack((np.sin(time), np.cos(time)))
    view.truth.add(time, {"position": rows})
    view.controller_state.add(time, {"reference_position": rows})
    view.time = 4.99
    hands.refresh()
    chart = next(e for e in hands.gui.middle.all() if e.kind == "chart")
    assert chart.data.updates["xAxis"] == {"min": 0.0, "max": 30.0}
    shown = {one["name"]: one for one in chart.data.options["series"][:-1]}
    assert list(shown) == ["a [rad]", "b [m]", "reference a [rad]", "reference b [m]"]
    for joint in ("a [rad]", "b [m]"):
        assert shown[f"reference {joint}"]["color"] == shown[joint]["color"]
        assert shown[f"reference {joint}"]["lineStyle"]["type"] == "dashed"
    known = [v for v in chart.data.updates["dataset"]["source"]["0"] if v is not None]
    assert max(known) == pytest.approx(2e-6, rel=1e-3)
    view.truth.clear()
    view.controller_state.clear()
    view.time = 0.0


def test_a_slider_scales_all_of_a_gain_and_comes_back(hands: Hands) -> None:
    hands.click("Tune pd")
    hands.refresh()
    field = hands.elements("kp")[-1]
    [slider] = [e for e in hands.gui.all() if e.kind == "slider" and e.label.startswith("kp ")]
    for power, text in (
        (1.0, "[4600.0, 4600.0]"),
        (-0.5, "[145.5, 145.5]"),
        (0.0, "[460.0, 460.0]"),
    ):
        slider.value = power
        for told in slider.changed:
            told(3)
        assert field.value == text


@pytest.mark.parametrize(
    "text", ["-1.0", "0.0", "[1.0, -1.0]", "soon", "true", "[", "", "{a: 1.0}"]
)
def test_only_positive_numbers_have_a_slider(text: str) -> None:
    assert scaled(text, 1.0) is None


def test_a_layout_is_saved_and_chosen(hands: Hands) -> None:
    charts = hands.elements("Chart")
    charts[0].value = quantities.VELOCITY
    hands.set("Name of the layout", "mine")
    hands.click("Save the layout")
    assert "mine" in hands.elements("Layout")[0].options
    layout = hands.elements("Layout")[0]
    for name, first in (("flight", quantities.POSITION), ("mine", quantities.VELOCITY)):
        layout.value = name
        for told in layout.changed:
            told(3)
        hands.page._context.work()
        assert charts[0].value == first


def test_what_does_nothing_after_the_end_is_gone(hands: Hands) -> None:
    view = hands.link.view
    before = view.now
    view.now = before._replace(state="finished")
    hands.refresh()
    gone = ("Start", "Reset", "Switch to pd", "Tune pd", "Plan", "Disturb", "Break", "Note it")
    for button in gone:
        assert not shown(hands.elements(button)[0]), button
    assert not hands.elements("Brake (space bar)")[0].enabled
    for button in ("Overlay it", "View from above", "Clear the charts"):
        assert shown(hands.elements(button)[0]), button
    view.now = before
    hands.refresh()
    assert shown(hands.elements("Start")[0])


def test_warnings_of_a_kind_that_follow_each_other_are_one_row(hands: Hands) -> None:
    view = hands.link.view
    for tick in range(1, 8):
        what = AnswerMissing("pd", 1) if tick != 4 else OperatorNote("it rings", "somebody")
        view.events.append(event_of(what, tick, 0.01 * tick, 0, "plant"))
        view.received += 1
    hands.refresh()
    [table] = [e for e in hands.gui.all() if e.kind == "table"]
    rows = [str(row["what"]) for row in table.data]
    assert len(rows) == 3
    assert "3 times since 0.05 s" in rows[0]
    assert "it rings" in rows[1]
    hands.set("Fold warnings", False)
    hands.refresh()
    assert len(table.data) == 7
    table.value = 3
    hands.click("events")
    assert hands.elements("Pause the view")[0].value
    hands.set("Fold warnings", True)


def test_a_table_that_leaves_events_out_says_so(hands: Hands) -> None:
    view = hands.link.view
    assert "The newest 200 rows" not in hands.texts()
    before = list(view.events)
    for tick in range(200):
        view.events.append(
            event_of(OperatorNote(f"remark {tick}", "me"), tick, 0.01 * tick, 0, "plant")
        )
    view.received += 1
    hands.refresh()
    assert "The newest 200 rows at most, of the last 2,000 events" in hands.texts()
    view.events.clear()
    view.events.extend(before)
    view.received += 1
    hands.refresh()
    assert "The newest 200 rows" not in hands.texts()


def test_reset_asks_before_it_ends_what_is_flown(hands: Hands) -> None:
    assert hands.elements("Reset")[0].kind == "confirm"


def test_forms_open_on_the_law_in_charge_and_stay_where_a_person_has_put_them(
    tmp_path: Path,
) -> None:
    link = FakeLink()
    link.view.controllers["after"] = link.view.controllers["pd"]._replace(name="after")
    link.view.now = link.view.now._replace(active="pd")
    page = Page(link, "127.0.0.1", 0, lambda words: None, layouts=tmp_path / "layouts.json")
    try:
        hands = Hands(page, link)
        hands.refresh()
        for field in ("Analysed controller", "Tuned controller"):
            assert hands.elements(field)[0].value == "pd"
            hands.set(field, "after")
        hands.refresh()
        for field in ("Analysed controller", "Tuned controller"):
            assert hands.elements(field)[0].value == "after"
    finally:
        page.close()


def test_fields_say_their_units_and_read_others_of_the_kind(hands: Hands) -> None:
    labels = [hands.elements(f"goal of {joint}")[-1].label for joint in "ab"]
    assert labels == ["goal of a [rad]", "goal of b [m]"]
    for field, text in (("goal of a", "57 deg"), ("goal of b", "30 cm"), ("start", "2 min")):
        hands.set(field, text)
    hands.set("duration", "0.5min")
    [(_, values)] = hands.click("Plan")
    asked = load_yaml(values["request"], "")
    assert asked["goal"] == pytest.approx({"a": 57.0 * pi / 180.0, "b": 0.3})
    assert (asked["start"], asked["duration"]) == (120.0, 30.0)


def test_a_quantity_of_a_disturbance_is_the_bench_to_judge_which_knows_its_joint(
    hands: Hands,
) -> None:
    hands.set("Disturbance", "constant")
    hands.refresh()
    hands.set("constant effort", "5 kN")
    for field in hands.elements("from"):  # of other forms, too
        field.value = "2 min"
    [(_, values)] = hands.click("Disturb")
    assert load_yaml(values["fault"], "")["disturbance"] == {"a": "5 kN"}
    assert values["at"] == 120.0
    hands.set("constant effort", "5 deg")
    assert hands.click("Disturb") == []
    assert (
        "constant effort: &#x27;5 deg&#x27; is not allowed: give a number in N m" in hands.texts()
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1e9", "goal of a: 1000000000.0 is not allowed: at most 1000 rad or m"),
        ("2 min", "goal of a: &#x27;2 min&#x27; is not allowed: give a number in rad, mrad, deg"),
    ],
)
def test_a_goal_that_is_none_is_refused_at_its_field_and_not_sent(
    hands: Hands, text: str, words: str
) -> None:
    hands.set("start", "12.0")
    hands.set("goal of a", text)
    assert hands.click("Plan") == []
    assert words in hands.texts()
    hands.set("goal of a", "0.5")


@pytest.mark.parametrize("number", [nan, inf, -inf, 1e300, None])
def test_a_page_that_opens_later_is_whole_whatever_stands_in_a_number(
    hands: Hands, number: float | None
) -> None:
    first = PageClient(hands.page.server.address)
    field = next(uuid for uuid, e in first.inputs.items() if e["label"].startswith("At ["))
    first.set(field, number)
    first.reach()
    late = PageClient(hands.page.server.address)
    assert {e["label"] for e in late.inputs.values()} == {e["label"] for e in first.inputs.values()}
    for page in (first, late):
        page.socket.close()


def test_a_page_opens_where_the_option_that_was_chosen_has_gone(hands: Hands) -> None:
    hands.set("Rate", "no rate any more")
    hands.refresh()
    late = PageClient(hands.page.server.address)
    assert "Step" in {e["label"] for e in late.inputs.values()}
    late.socket.close()


def test_the_form_of_a_plan_opens_on_the_method_that_flies(tmp_path: Path) -> None:
    link = FakeLink()
    page = Page(link, "127.0.0.1", 0, lambda words: None, layouts=tmp_path / "layouts.json")
    hands = Hands(page, link)
    try:
        hands.refresh()
        assert hands.elements("Method")[-1].value == "optimized_feedforward"
        link.view.plan = SimpleNamespace(
            method="time_optimal", hash="a", joint_names=("a", "b"), start=0.0, period=0.1,
            position=np.zeros(8), effort=np.zeros(6), summary="{}",
            request="{method: time_optimal, goal: {a: 0.3}, duration: 8.0, functions: 12}",
        )  # fmt: skip
        hands.refresh()
        assert hands.elements("Method")[-1].value == "time_optimal"
        for field, text in (("goal of a", "0.3"), ("goal of b", "0.0"), ("duration", "8.0")):
            assert hands.elements(field)[-1].value == text
        hands.set("Method", "input_shaping")  # whatever flies next, this was chosen
        link.view.plan = SimpleNamespace(**{**vars(link.view.plan), "hash": "b"})
        hands.refresh()
        assert hands.elements("Method")[-1].value == "input_shaping"
    finally:
        page.close()


@pytest.mark.parametrize("order", list(permutations(["first", "second", "third"])))
@pytest.mark.parametrize("chooses", [False, True])
def test_lists_of_controllers_open_on_the_one_in_charge_whoever_is_heard_first(
    order: tuple[str, ...], chooses: bool
) -> None:
    field = Gui().choice("Controller", ("nobody",))
    opened, expected = OpenedOn(field), "second"
    for count in range(1, 4):
        opened.offer(tuple(sorted(order[:count])), "nobody", "second")
        if chooses and "third" in order[:count] and field.value != "third":
            field.value = expected = "third"
    opened.offer(tuple(sorted(order)), "nobody", "second")
    assert field.value == expected
