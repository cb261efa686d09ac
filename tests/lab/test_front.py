"""`import flexslew`: objects in place of names, grids of trials, no module of Linux alone."""

import json
import pickle
import re
import subprocess
import sys
import threading
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import control
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.representatives import representatives

import flexslew as fs
from flexslew_lab.given_objects import with_law
from flexslew_lab.studies.study import load_study
from flexslew_lab.trial.trial import plan_of_trial
from flexslew_plant.own_code import ANY_CODE
from flexslew_plant.settings import plain

SHORT: dict[str, Any] = {"name": "short", "duration": 2.0, "testbed": {"modes": 1}}
SLEW = {**SHORT, "plan": {"method": "reference_only", "goal": {"base_yaw": 0.01}, "duration": 1.0}}


def push(measurement: Any, reference: Any) -> Any:
    return 460.0 * (reference.position - measurement.joint_position)


class Push:
    def __init__(self, settings: Any, period: float, effort_limit: Any) -> None:
        self.kp = settings.get("kp", 460.0)

    def update(self, measurement: Any, estimate: Any, reference: Any) -> Any:
        return self.kp * (reference.position - measurement.joint_position)


def cubic(ticks: int, *goal: float) -> Any:
    s = np.linspace(0.0, 1.0, ticks + 1)[:, None]
    return (3.0 * s**2 - 2.0 * s**3) * np.array(goal)


@pytest.fixture(scope="module")
def flight() -> fs.Flight:
    return fs.fly(fs.trial(SHORT, law=push, plan=cubic(100, 0.2, 0.1)))


def test_a_function_and_a_class_given_as_objects_fly_the_same_bits(flight: fs.Flight) -> None:
    other = fs.fly(fs.trial(SHORT, law=Push, plan=cubic(100, 0.2, 0.1)))
    assert other.metrics["trajectory_hash"] == flight.metrics["trajectory_hash"]
    assert np.array_equal(flight["effort.base_yaw"][1:3], [0.0, 460.0 * cubic(100, 0.2)[1, 0]])


def test_positions_given_as_an_array_are_the_reference_at_every_tick(flight: fs.Flight) -> None:
    assert np.array_equal(flight["reference"][:101], cubic(100, 0.2, 0.1))
    assert flight["reference.hub_pitch"][150] == 0.1
    assert flight.metrics["manoeuvre_end"] == 1.0


def test_a_plan_that_was_made_elsewhere_is_flown(flight: fs.Flight) -> None:
    rows = cubic(100, 0.2, 0.1)
    rates = np.gradient(rows, 0.01, axis=0)
    names, none = ("base_yaw", "hub_pitch"), np.zeros((101, 0))
    made = fs.Plan("mine", names, 0.5, 0.01, rows, rates, np.zeros((100, 2)), none, 1.0)
    flown = fs.fly(fs.trial(SHORT, law=push, plan=made))
    assert np.array_equal(flown["reference"][50:151], rows)


@pytest.mark.slow
@pytest.mark.parametrize(
    "law", representatives(["lqr", "output_feedback", "proportional_integral"], "lqr")
)
def test_a_given_plan_flies_as_the_planner_that_made_it(law: str) -> None:
    """Laws with filters about the plan take its nominal state, too."""
    changes = {"duration": 3.0, "controllers": {law: {}}, "active": law}
    made = plan_of_trial(fs.trial("m1", changes))
    assert made is not None
    given = fs.fly(fs.trial("m1", changes, plan=made))
    own = fs.fly(fs.trial("m1", changes))
    assert given.metrics["trajectory_hash"] == own.metrics["trajectory_hash"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    representatives(
        ["control_moment_gyros", "setpoint_shaping", "observatory"], "control_moment_gyros"
    ),
)
def test_a_craft_without_a_typical_goal_flies_given_plans_and_positions(name: str) -> None:
    slow = {"duration": 1.0, "schedule": [], "plan.duration": 300.0}
    short = fs.trial(fs.trial(name, plan="reference_only"), slow)
    own = fs.fly(short)
    given = fs.fly(fs.trial(short, plan=fs.plan(short)))
    assert given.metrics["trajectory_hash"] == own.metrics["trajectory_hash"]
    rows = np.repeat(own["reference"][:1], 6, axis=0)
    assert np.array_equal(fs.fly(fs.trial(short, plan=rows))["reference"][:6], rows)
    with pytest.raises(fs.BadInput, match="goal: missing; give one to some of the joints"):
        fs.plan(fs.trial(short, {"plan.goal": None, "plan.model": None}))


def test_a_given_plan_is_kept_as_it_was_given_and_has_gains_too() -> None:
    rows = cubic(100, 0.2, 0.1)
    names, efforts = ("base_yaw", "hub_pitch"), np.zeros((100, 2))
    state, gains = np.ones((101, 6)), np.full((101, 3), 7.0)
    made = fs.Plan("mine", names, 0.5, 0.01, rows, 0.0 * rows, efforts, state, 1.0, gains)
    given = fs.trial(SHORT, plan=made)
    rows[:], efforts[:] = 9.0, 9.0
    flown = plan_of_trial(given)
    assert flown is not None
    assert np.array_equal(flown.position, cubic(100, 0.2, 0.1))
    assert not flown.effort.any()
    assert np.array_equal(flown.state, state)
    assert np.array_equal(flown.gains, gains)
    assert (flown.start, flown.duration) == (0.5, 1.0)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"period": 0.02}, r"plan: has a period of 0\.02 s; that of this trial is 0\.01 s"),
        ({"joint_names": ("hub_pitch", "base_yaw")}, "plan: moves hub_pitch, base_yaw; this bench"),
        ({"velocity": np.zeros((100, 2))}, r"plan: velocity of shape \(100, 2\) does not fit"),
        (
            {"effort": np.zeros((100, 3))},
            r"plan: effort of shape \(100, 3\) does not fit 100 ticks",
        ),
        ({"state": np.zeros(101)}, r"plan: state of shape \(101,\) does not fit"),
        ({"duration": 2.0}, "plan: duration: 2 s is longer than its 100 ticks"),
    ],
)
def test_a_given_plan_of_another_bench_is_refused_in_one_line(changes: Any, words: str) -> None:
    rows = cubic(100, 0.2, 0.1)
    names, none = ("base_yaw", "hub_pitch"), np.zeros((101, 0))
    made = fs.Plan("mine", names, 0.0, 0.01, rows, 0.0 * rows, np.zeros((100, 2)), none, 1.0)
    with pytest.raises(fs.BadInput, match=words):
        fs.fly(fs.trial(SHORT, plan=replace(made, **changes)))


def test_the_name_of_a_method_plans_the_same_manoeuvre() -> None:
    changes = {"plan.goal.hub_pitch": 0.2, "plan.start": 1.0}
    for method in ("reference_only", "none", "start_coast_stop", "optimized_feedforward"):
        plan: Any = fs.trial("m1", changes, plan=method).plan
        assert (plan.method, plan.start) == (method, 1.0)
        assert plan.goal == {"base_yaw": 1.0, "hub_pitch": 0.2}
    plan = fs.trial(SHORT, plan="none").plan
    assert plan.method == "none"
    with pytest.raises(fs.BadInput, match=r"m1: plan.*wishing"):
        fs.trial("m1", plan="wishing")


def test_the_name_of_a_controller_of_the_trial_keeps_its_settings() -> None:
    stiff = {"pd_feedforward": {"kp": 700.0}, "lqr": {}}
    keys = {**SHORT, "controllers": stiff, "active": "lqr"}
    chosen = fs.trial(keys, law="pd_feedforward")
    assert (chosen.active, chosen.controllers["pd_feedforward"]["kp"]) == ("pd_feedforward", 700.0)
    other = fs.trial(keys, law="collocated_pid")
    assert other.active == "collocated_pid"
    assert list(other.controllers) == ["pd_feedforward", "lqr", "collocated_pid"]


LEAD = control.ss(control.tf([920.0, 460.0], [0.1, 1.0]))


def test_a_system_of_python_control_is_a_law() -> None:
    """Its efforts are those of the same recursion in NumPy, of measured errors."""
    flown = fs.fly(fs.trial(SLEW, law=control.append(LEAD, LEAD)))
    tick = control.sample_system(LEAD, 0.01, "tustin")
    error = flown["reference"][:-1] - flown["measured"][:-1]
    x, efforts = np.zeros(2), []
    for row in error:
        efforts.append(tick.C[0, 0] * x + tick.D[0, 0] * row)
        x = tick.A[0, 0] * x + tick.B[0, 0] * row
    demand = flown["feedforward"][:-1] + efforts
    assert np.abs(demand).max() > 0.1
    assert flown["effort"][1:] == pytest.approx(demand, rel=0, abs=1e-12)


def test_a_system_says_by_its_labels_what_it_listens_to_and_keeps_the_settings_of_linear() -> None:
    labels = {"inputs": ["position:hub_pitch", "tip:beam_positive"], "outputs": "effort:hub_pitch"}
    gain = control.ss([], [], [], [[-460.0, 0.5]], **labels)
    before = {"linear": {"feedforward": False, "file": "old.npz"}, "pd_feedforward": {}}
    given = fs.trial({**SLEW, "controllers": before, "active": "pd_feedforward"}, law=gain)
    kept = given.controllers["linear"]
    assert (given.active, kept["feedforward"], "file" in kept) == ("linear", False, False)
    assert kept["system"]["inputs"] == ["position.hub_pitch", "tip.beam_positive"]
    assert kept["system"]["d"] == [[-460.0, 0.5]]
    other = fs.trial(SLEW, law=control.tf([1.0, 0.0], [0.1, 1.0], inputs="a:x", outputs="b:y"))
    assert other.controllers["linear"]["system"]["outputs"] == ["b.y"]
    mine = {"controllers": {"linear": {"law": "pd_feedforward", "kp": 1.0}}, "active": "linear"}
    assert set(fs.trial({**SLEW, **mine}, law=gain).controllers["linear"]) == {"system"}


def test_positions_of_a_spacecraft_are_the_reference_of_all_its_joints() -> None:
    keys = {"name": "craft", "duration": 2.0, "testbed": {"kind": "spacecraft"}}
    rows = cubic(100, 0.02, -0.01, 0.03)
    flown = fs.fly(fs.trial(keys, {"controllers": {"pd_feedforward": {"kp": [50.0], "kd": [70.0]}}},
                            plan=rows))  # fmt: skip
    assert np.array_equal(flown["reference"][:101], rows)
    assert flown.names("reference") == ("reference.roll", "reference.pitch", "reference.yaw")


def test_rates_of_attitudes_given_at_every_tick_are_body_rates() -> None:
    """Of a path about an axis that turns, by SciPy's rotations; joints of one axis stay as was."""
    c = cubic(200, 1.0)
    path = np.hstack((1.2 * c, 0.9 * c**2, -0.7 * np.sin(np.pi * c)))
    made = plan_of_trial(fs.trial("three_axes", plan=path))
    assert made is not None
    turned = Rotation.from_rotvec(path)
    rates = (turned[:-2].inv() * turned[2:]).as_rotvec() / (2.0 * made.period)
    assert np.abs(rates - np.gradient(path, made.period, axis=0)[1:-1]).max() > 0.2
    assert made.velocity[1:-1] == pytest.approx(rates, rel=0, abs=1e-12)
    assert not made.velocity[[0, -1]].any()
    about_one = plan_of_trial(fs.trial("three_axes", plan=c * [1.0, 0.0, 0.0]))
    assert about_one is not None
    plain_rates = np.gradient(c[:, 0], made.period)[1:-1]
    assert about_one.velocity[1:-1, 0] == pytest.approx(plain_rates, rel=0, abs=1e-12)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"plan": np.zeros(4)}, r"shape \(4,\) is not allowed: \(ticks \+ 1, joints\)"),
        ({"plan": np.zeros((5, 3))}, r"shape \(5, 3\) does not fit: \(5, 2\): base_yaw"),
        ({"plan": np.full((5, 2), np.nan)}, "not finite"),
        ({"plan": np.zeros((5, 2), dtype=complex)}, "complex128 is not allowed: give real numbers"),
        ({"plan": np.array([["a", "b"], ["c", "d"]])}, "<U1 is not allowed: give real numbers"),
        ({"plan": np.array([["a", "b"], ["c", "d"]], dtype=object)}, "give real numbers"),
        ({"plan": np.ma.masked_less(np.zeros((5, 2)), 1.0)}, "some of its numbers are masked"),
        ({"law": int}, r"int is not allowed: a class with update"),
        ({"law": 3.0}, "a float is not allowed"),
        ({"law": np.eye(2)}, "a ndarray is not allowed: give a class, a function, a system"),
        ({"law": lambda measurement: [0.0, 0.0]}, "is asked .*: too many"),
        ({"law": lambda m, e, r: [0.0, 0.0]}, "is asked .*: missing a required argument: 'r'"),
        ({"law": control.ss(-1, 1, 1, 0, True)}, "law: dt is unspecified"),
        ({"law": control.ss(-1, 1, 1, 0, inputs="e", outputs="u")}, "law: e is no signal of the"),
        ({"law": LEAD}, "outputs"),
        ({"law": control.tf([1, 0, 0], [1, 1])}, "law: is no state space"),
        ({"law": control.nlsys(None, lambda t, x, u, p: u)}, "it is a NonlinearIO"),
    ],
)
def test_an_object_that_does_not_fit_is_refused_in_one_line(given: Any, words: str) -> None:
    with pytest.raises(fs.BadInput, match=words):
        fs.fly(fs.trial(SHORT, **given))


def test_a_trial_is_changed_as_its_keys_are(flight: fs.Flight) -> None:
    given = fs.trial(SLEW, {"testbed.modes": 2})
    changes = {"plan.duration": 1.5, "controllers.pd_feedforward.kp": [500.0]}
    changed, whole = fs.trial(given, changes), fs.trial(SLEW, {"testbed.modes": 2, **changes})
    assert changed == whole
    assert fs.trial(given) == given
    pushed = fs.trial(fs.trial(SHORT, law=push), {"seed": 1}, plan=cubic(100, 0.2, 0.1))
    assert fs.fly(pushed).metrics["trajectory_hash"] == flight.metrics["trajectory_hash"]
    axes = {"plan.duration": [1.0, 1.5]}
    one, other = fs.sweep(given, axes), fs.sweep(SLEW, axes, {"testbed.modes": 2})
    np.testing.assert_equal(one["residual_tip_deflection"], other["residual_tip_deflection"])


def test_a_sweep_has_an_axis_per_path_and_the_numbers_of_single_flights() -> None:
    found = fs.sweep(SLEW, {"testbed.modes": np.array([1, 2]), "plan.duration": [0.5, 1.0, 1.5]})
    tips = found["residual_tip_deflection"]
    assert tips.shape == (2, 3)
    alone = fs.fly(fs.trial(SLEW, {"testbed.modes": 2, "plan.duration": 1.0}))
    assert tips[1, 1] == alone.metrics["residual_tip_deflection"]
    assert "testbed.modes (2) x plan.duration (3)" in repr(found)
    page = found._repr_html_()
    assert page.count("<tr>") == 1 + tips.size
    assert f"<td>{tips[1, 1]:.3g}</td>" in page
    assert "<th>missed_ticks</th>" not in page  # as many at every point
    long = fs.Sweep({"x": tuple(range(50))}, {"y": np.arange(50.0)})._repr_html_()
    assert long.endswith("</table>and 10 more")
    assert fs.Sweep({}, {"y": np.array(1.0)})._repr_html_().count("<tr>") == 2
    with pytest.raises(fs.BadInput, match=r"testbed\.modes has no values"):
        fs.sweep(SLEW, {"testbed.modes": []})


def test_a_sweep_tells_what_its_flights_warn_of() -> None:
    with pytest.warns(UserWarning, match=r"sweep point 2 and 1 more: the plan ends at 9 s") as told:
        fs.sweep(SLEW, {"plan.duration": [0.5, 9.0], "seed": [1, 2]}, {"plan.start": 0.0})
    assert [Path(one.filename).name for one in told] == ["test_front.py"]


def test_every_point_of_the_sweep_in_the_docs_has_a_plan() -> None:
    page = (Path(__file__).parents[2] / "docs/library.md").read_text(encoding="utf-8")
    found = re.search(r'fs\.sweep\("m1", (\{.*\})\)', page)
    assert found is not None
    axes = eval(found[1], {"np": np})
    assert f"({', '.join(str(len(values)) for values in axes.values())});" in page
    for modes in axes["testbed.modes"]:  # the shortest manoeuvre needs the most
        keys = {"testbed.modes": modes, "plan.duration": min(axes["plan.duration"])}
        assert plan_of_trial(fs.trial("m1", keys)) is not None


def test_axes_of_a_sweep_may_hold_lists_and_sections_and_bear_the_name_of_a_metric(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    axes: dict[str, Any] = {
        "duration": (time for time in (0.5, 1.0)),
        "controllers.pd_feedforward.kp": [100.0, np.array([100.0, 200.0])],
    }
    found = fs.sweep({**SLEW, "plan": None}, axes)
    assert found["peak_effort.hub_pitch"].shape == (2, 2)
    assert found.axes["controllers.pd_feedforward.kp"] == (100.0, [100.0, 200.0])
    index = SimpleNamespace(
        from_product=lambda labels, names: dict(zip(names, labels, strict=True))
    )
    frames = SimpleNamespace(MultiIndex=index, DataFrame=lambda columns, index: (columns, index))
    monkeypatch.setitem(sys.modules, "pandas", frames)
    columns, rows = found.frame()
    labels = {"duration": [0.5, 1.0], "controllers.pd_feedforward.kp": ["100.0", "[100.0, 200.0]"]}
    assert rows == labels
    assert columns["duration"].tolist() == [0.5, 0.5, 1.0, 1.0]
    sets = SimpleNamespace(Dataset=lambda data, coordinates: (data, coordinates))
    monkeypatch.setitem(sys.modules, "xarray", sets)
    data, coordinates = found.xarray()
    assert coordinates == labels
    assert not data.keys() & coordinates.keys()
    assert fs.sweep({**SLEW, "duration": 0.1, "plan": None}).frame()[1] is None


@pytest.mark.parametrize(
    ("changes", "axes"), [({"testbed.modes": 2}, {}), ({}, {"testbed.modes": [2]})]
)
def test_an_axis_does_not_replace_what_was_set_before_it(
    changes: dict[str, Any], axes: dict[str, Any]
) -> None:
    with pytest.raises(fs.BadInput, match=r"testbed would replace testbed\.modes"):
        fs.sweep(SLEW, {**axes, "testbed": [{"modes": 1}]}, changes)


@pytest.mark.parametrize("given", [3.0, "abc", {"a": 1.0}, None, np.array(3.0)])
def test_an_axis_that_is_no_list_is_refused(given: Any) -> None:
    with pytest.raises(
        fs.BadInput, match=r"testbed\.modes: .* is not allowed: give a list of values"
    ):
        fs.sweep(SLEW, {"testbed.modes": given})


def test_a_function_is_asked_once_a_tick_and_by_nobody_but_the_flight() -> None:
    asked: list[int] = []

    def remembers(measurement: Any, reference: Any) -> Any:
        asked.append(measurement.tick)
        return push(measurement, reference)

    flown = fs.fly(fs.trial(SLEW, law=remembers))
    assert asked == list(range(200))
    assert (
        flown.metrics["trajectory_hash"]
        == fs.fly(fs.trial(SLEW, law=Push)).metrics["trajectory_hash"]
    )


def test_laws_of_one_name_are_told_apart_whichever_thread_gives_them() -> None:
    def made(effort: float) -> Any:
        def law(measurement: Any, reference: Any) -> Any:
            return [effort, 0.0]

        return law

    def give(first: int) -> None:
        begin.wait()
        for k in range(first, first + 100):
            keys[k] = with_law({}, made(float(k)))

    keys: dict[int, dict[str, Any]] = {}
    before, begin = sys.getswitchinterval(), threading.Barrier(8)
    sys.setswitchinterval(1e-6)
    try:
        threads = [threading.Thread(target=give, args=(100 * k,)) for k in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        sys.setswitchinterval(before)
    names = [found["controllers"]["law"]["law"] for found in keys.values()]
    assert len(set(names)) == len(keys) == 800


def test_an_object_that_is_given_again_is_the_same_law_or_plan() -> None:
    """So a loop over trials keeps one copy of it, and its trials have one text."""
    made = plan_of_trial(fs.trial(SLEW))
    for given in ({"law": push}, {"plan": cubic(100, 0.2, 0.1)}, {"plan": made}):
        first, again = fs.trial(SHORT, **given), fs.trial(SHORT, **deepcopy(given))
        assert plain(first) == plain(again)
    other = fs.trial(SHORT, plan=cubic(100, 0.2, 0.11))
    assert other.plan != fs.trial(SHORT, plan=cubic(100, 0.2, 0.1)).plan
    assert fs.trial(SHORT, law=lambda m, r: push(m, r)) != fs.trial(
        SHORT, law=lambda m, r: push(m, r)
    )


def test_efforts_that_are_complex_fail_the_law() -> None:
    flown = fs.fly(fs.trial({**SHORT, "duration": 0.2}, law=lambda *_: [1.0 + 2.0j, 0.0]))
    assert flown.metrics["peak_effort"]["base_yaw"] == 0.0
    assert any("is complex" in event.message for event in flown.events)


def test_a_law_with_efforts_of_a_wrong_shape_raises_one_line() -> None:
    class Short:
        def __init__(self, settings: Any, period: float, effort_limit: Any) -> None:
            pass

        def update(self, measurement: Any, estimate: Any, reference: Any) -> Any:
            return np.zeros(1)

    words = r"^law: Short gave efforts of shape \(1,\), expected \(2,\)$"
    with pytest.raises(fs.BadInput, match=words):
        fs.fly(fs.trial({**SHORT, "duration": 0.2}, law=Short))


def test_a_flight_says_why_a_law_fell_silent() -> None:
    def breaks(measurement: Any, reference: Any) -> Any:
        raise ZeroDivisionError("of mine")

    flown = fs.fly(fs.trial({**SHORT, "duration": 0.2}, law=breaks))
    assert "breaks is silent: the brake takes over" in repr(flown)
    assert "raised ZeroDivisionError: of mine (" in repr(flown)
    assert "test_front.py, line" in repr(flown)


def test_a_flight_tells_the_names_of_its_signals(flight: fs.Flight) -> None:
    assert list(flight) == list(flight.signals)
    assert "tip" in flight
    assert "tip.beam_positive" in flight
    assert "tip.beam" not in flight
    assert len(flight.plot(*flight).data) == len(flight.signals)


def test_a_flight_is_short_to_look_at_and_shows_no_markup_of_others(flight: fs.Flight) -> None:
    assert repr(flight).startswith("<Flight short: 201 ticks, ")
    assert len(repr(flight)) < 400
    page = replace(flight, trial={"name": "<b>"})._repr_html_()
    assert page.startswith(f"<b>&lt;b&gt;</b>: {flight.verdict}<br>")
    assert "<td>N m</td>" in page
    assert "N m or N" not in page  # both joints turn


def test_a_trial_is_one_line_to_look_at(tmp_path: Path) -> None:
    assert repr(fs.trial("m1")).startswith("<Trial m1: csa, 100 s, ")
    held = fs.trial({"name": "held", "testbed": {"kind": "identified"}, "plan": None})
    assert repr(held) == "<Trial held: identified, 100 s, no plan; pd_feedforward>"
    given = fs.trial(SHORT, law=push, plan=cubic(100, 0.2, 0.1))
    assert len(repr(given)) < 200, repr(given)


def test_a_flight_becomes_a_dataset_with_units(
    flight: fs.Flight, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: Any = SimpleNamespace(Dataset=lambda data, coordinates, attributes: (data, coordinates))
    monkeypatch.setitem(sys.modules, "xarray", made)
    data, coordinates = flight.xarray()
    assert data["effort.base_yaw"][2] == {"units": "N m"}
    assert coordinates["time"][1] is flight.time


@pytest.mark.slow
def test_a_study_of_keys_flies_a_trial_with_an_object_that_is_numbers(tmp_path: Path) -> None:
    flown = fs.trial({**SHORT, "duration": 0.2}, law=control.append(LEAD, LEAD))
    keys = {
        "study": "mine",
        "trial": flown,
        "sampling": {"n": np.int64(2)},
        "vary": {"testbed.parameters.bending_stiffness": {"relative": {"uniform": [-0.1, 0.1]}}},
        "keep": {"bags": "none"},
    }
    found = fs.study(keys, tmp_path / "mine")
    assert (found["trials"], found["failed"], found["variants"]) == (2, 0, [""])
    kept = tmp_path / "mine/study.yaml"  # with its trial it is the same study
    assert load_study(kept, ANY_CODE).base == plain(flown)
    for given in (fs.trial(SHORT, law=push), fs.trial(SHORT, plan=cubic(100, 0.2, 0.1))):
        with pytest.raises(fs.BadInput, match="is an object of this process"):
            fs.study({**keys, "trial": given}, tmp_path / "other")
    with pytest.raises(fs.BadInput, match="trial: is missing"):
        fs.study({"study": "mine"}, tmp_path / "other")


@pytest.mark.slow
def test_an_analysis_about_a_rest_is_short_to_look_at() -> None:
    found = fs.analyse({**SHORT, "plan": None}, hub_pitch=0.5)
    assert found.plain()["rest"] == {"base_yaw": 0.0, "hub_pitch": 0.5}
    words = f"disk margin {found.disks['input'].alpha:.3g} and delay margin"
    assert repr(found).startswith(
        f"<Analysis of pd_feedforward: {len(found.poles)} poles, stable; "
    )
    assert words in repr(found)
    with pytest.raises(fs.BadInput, match="hub is not a joint of the testbed"):
        fs.analyse(SHORT, hub=0.5)


@pytest.mark.slow
def test_studies_are_listed_without_what_reads_their_tables(tmp_path: Path) -> None:
    code = (
        "import sys; sys.modules['pyarrow'] = None\n"
        "from flexslew_lab.cli.main import app; app(['study', 'list', '--json'])"
    )
    (tmp_path / "runs/study-x").mkdir(parents=True)
    kept = {"study": {"study": "theirs"}, "variants": [], "varied": [], "columns": []}
    (tmp_path / "runs/study-x/study.json").write_text(json.dumps(kept))
    command = [sys.executable, "-P", "-c", code]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert "theirs" in [row["study"] for row in json.loads(done.stdout)]


@pytest.mark.parametrize(
    ("package", "use"),
    [
        ("pandas", lambda flight: flight.frame()),
        ("xarray", lambda flight: flight.xarray()),
        ("pandas", lambda flight: fs.Sweep({}, {}).frame()),
        ("xarray", lambda flight: fs.Sweep({}, {}).xarray()),
        ("pyarrow", lambda flight: fs.study("csa_robustness")),
    ],
)
def test_what_needs_a_package_that_is_not_there_says_what_installs_it(
    package: str, use: Any, flight: fs.Flight, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    words = rf"{package} is not installed: (./flexslew extras export|pip install .flexslew\[)"
    with pytest.raises(ModuleNotFoundError, match=words):
        use(flight)


@pytest.mark.parametrize("name", ["m1", "three_axes", "docs/examples/three_joints.py:ThreeJoints"])
def test_a_trial_travels_to_a_process_that_has_not_loaded_its_testbed(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = fs.trial({"testbed": {"kind": name}, "duration": 1.0} if ".py:" in name else name)
    keys, sent = plain(given), pickle.dumps(given)
    for loaded in [module for module in sys.modules if module.startswith("flexslew_user_")]:
        monkeypatch.delitem(sys.modules, loaded)
    there = pickle.loads(sent)
    assert plain(there) == keys
    assert there.trust == given.trust
    assert there.testbed.model().joint_names == given.testbed.model().joint_names


LONG = "x" * 300


@pytest.mark.parametrize("name", [LONG, f"{LONG}.py:Law", f"{LONG}/{LONG}"])
def test_a_name_that_is_too_long_for_a_file_is_refused_in_one_line(
    name: str, tmp_path: Path
) -> None:
    file = tmp_path / "study.yaml"
    one = "sampling: {n: 1}\nvary: {testbed.damping_ratio: {uniform: [0.0, 0.1]}}\n"
    file.write_text(f"study: long\ntrial: {name}\n{one}")
    linear = {**SHORT, "controllers": {"linear": {"file": f"{name}.npz"}}, "active": "linear"}
    panel = {"hinge": {"place": [0.0, 1.0, 0.0]}, "shape": {"kind": "modal_data", "file": name}}
    craft = {"testbed": {"kind": "spacecraft", "appendages": {"panel": panel}}}
    for use in (
        lambda: fs.read(name),
        lambda: fs.study(name),
        lambda: fs.study(file),
        lambda: fs.trial(name),
        lambda: fs.fly(linear),
        lambda: fs.fly(craft),
    ):
        with pytest.raises(fs.BadInput):
            use()


@pytest.mark.parametrize("name", [LONG, f"study.yaml/{LONG}", "study.yaml"])
def test_a_study_in_no_folder_is_refused_in_one_line(name: str, tmp_path: Path) -> None:
    (tmp_path / "trial.yaml").write_text("duration: 0.1\ntestbed: {modes: 1}\n")
    file = tmp_path / "study.yaml"
    file.write_text(
        "study: small\ntrial: trial.yaml\nsampling: {n: 1}\n"
        "vary: {testbed.damping_ratio: {uniform: [0.0, 0.1]}}\n"
    )
    with pytest.raises(fs.BadInput):
        fs.study(file, tmp_path / name)


def test_a_bench_is_stepped_by_hand() -> None:
    keys = {**SHORT, "duration": 0.5, "testbed": {"modes": 1, "initial": {"base_yaw": 0.1}}}
    bench = fs.bench(keys)
    assert (bench.tick, bench.question.tick) == (0, 0)
    while not bench.done:
        seen = bench.question
        effort = -600.0 * seen.joint_position - 900.0 * seen.joint_velocity
        assert bench.offer(fs.EffortCommand(seen.tick, seen.epoch, seen.controller, effort))
        bench.advance()
    flown = fs.fly(
        fs.trial(keys, law=lambda m, r: -600.0 * m.joint_position - 900.0 * m.joint_velocity)
    )
    assert np.array_equal(bench.truth().position, flown["position"][-1])
    assert bench.truth().position[0] != 0.1


ELSEWHERE = """
import os, signal, sys
import numba, plotly.graph_objects, scipy.signal, control, rosbags.typesys, mcap.writer, typer
import multiprocessing.pool, tempfile, webbrowser
for name in ("fcntl", "termios", "resource", "pwd", "grp", "pty", "tty", "syslog", "msvcrt"):
    sys.modules[name] = None
for place, names in (
    (os, ("getuid", "geteuid", "fork", "O_NOFOLLOW", "sched_getaffinity", "killpg", "setsid")),
    (signal, ("SIGKILL", "SIGBUS", "SIGHUP", "SIGCHLD", "SIGUSR1", "SIGALRM")),
):
    for name in names:
        delattr(place, name)
import flexslew as fs
import flexslew_lab.cli.main
flight = fs.fly(fs.trial({"duration": 0.1, "testbed": {"modes": 1}}))
print(flight.metrics["ticks"])
"""


@pytest.mark.slow
def test_it_imports_and_flies_where_no_module_is_there_that_linux_alone_has() -> None:
    child = subprocess.run(
        [sys.executable, "-c", ELSEWHERE], capture_output=True, text=True, check=False
    )
    assert child.stderr == ""
    assert child.stdout == "10\n"


@pytest.mark.parametrize(
    "effort", [[1.0, -2.0], (1, -2), np.array([1, -2]), np.array([1.0, -2.0], np.float32)]
)
def test_efforts_given_by_hand_may_be_a_list_or_of_any_precision(effort: Any) -> None:
    bench = fs.bench(SHORT)
    asked = bench.question
    assert bench.offer(fs.EffortCommand(asked.tick, asked.epoch, asked.controller, effort))
    bench.advance()
    assert np.array_equal(bench.question.applied_effort, [1.0, -2.0])
    assert bench.question.applied_effort.dtype == np.float64


@pytest.mark.parametrize("effort", ["ab", None, 1j * np.ones(2), [[1.0], [1.0, 2.0]], 3j])
def test_efforts_that_are_no_numbers_are_refused_in_words(effort: Any) -> None:
    bench = fs.bench(SHORT)
    asked = bench.question
    with pytest.raises(fs.BadInput, match=r"^effort: .* one per joint"):
        bench.offer(fs.EffortCommand(asked.tick, asked.epoch, asked.controller, effort))


@pytest.mark.slow
def test_a_rest_may_have_a_unit_and_one_of_another_kind_is_refused() -> None:
    turned = fs.linear_model(SHORT, hub_pitch="30 deg").A
    assert np.array_equal(turned, fs.linear_model(SHORT, hub_pitch=np.radians(30.0)).A)
    for wrong in ("3 cm", "soon", None, [1.0, 2.0]):
        with pytest.raises(fs.BadInput, match=r"^rest of hub_pitch: "):
            fs.linear_model(SHORT, hub_pitch=wrong)  # type: ignore[arg-type]
    assert fs.analyse(SHORT, at="20 ms").point.rest.time == pytest.approx(0.02)
    for ask in (fs.linear_model, fs.analyse):
        with pytest.raises(fs.BadInput, match=r"^--at: 'soon' is not allowed"):
            ask(SHORT, at="soon")


def test_a_flight_that_is_to_be_identified_says_that_it_needs_a_folder() -> None:
    with pytest.raises(fs.BadInput, match=r"^runs: a flight keeps no log; .* 'runs/shaken'"):
        fs.identify(fs.fly(SHORT))  # type: ignore[arg-type]


def test_what_is_no_place_no_number_and_no_keys_is_refused_in_one_line() -> None:
    given: Any = fs
    wrong: Any
    for wrong in (3, ["runs"], SHORT, b"runs", None):
        with pytest.raises(fs.BadInput, match=r"^run: .* is not allowed: give a path"):
            given.read(wrong)
    with pytest.raises(fs.BadInput, match=r"^folder: 3 is not allowed: give a path"):
        given.fly(SHORT, 3)
    for wrong in (0, 1.5, "2", None):
        with pytest.raises(fs.BadInput, match=r"^workers: .* a whole number, at least 1"):
            given.study("acc_benchmark", workers=wrong)
    for wrong in ("duration", 5.0, [1.0]):
        with pytest.raises(fs.BadInput, match=r"^changes: .* is not allowed: give keys"):
            given.trial("m1", wrong)
        with pytest.raises(fs.BadInput, match=r"^axes: .* is not allowed: give keys"):
            given.sweep("m1", wrong)
