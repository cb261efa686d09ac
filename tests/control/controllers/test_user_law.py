import importlib
import os
import sys
from hashlib import sha256
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.plants import plant

from flexslew_control.controllers import build_controller, settings_text, user_law
from flexslew_control.law import Estimate, PlantDescription
from flexslew_lab.run.in_process import run_bench
from flexslew_plant import own_code
from flexslew_plant.bench.bench import Bench, BenchSettings
from flexslew_plant.errors import BadInput
from flexslew_plant.events import Level
from flexslew_plant.measurement import Measurement
from flexslew_plant.own_code import ANY_CODE, LAWS, NO_CODE
from flexslew_plant.settings import Positive, section, validated
from flexslew_plant.yaml_data import load_yaml

ROOT = Path(__file__).parents[3]
EXAMPLE = f"{ROOT / 'docs' / 'examples' / 'my_law.py'}:MyLaw"
JOINTS, LIMIT = ("base_yaw", "hub_pitch"), (150.0, 150.0)
MAX_MISSED = 5


class Steady:
    """A law that does nothing wrong."""

    def __init__(self, settings: Any, period: Any, effort_limit: Any) -> None:
        self.settings, self.period, self.effort_limit = settings, period, effort_limit
        self.terms: dict[str, Any] = {"steady": [1.0, 2.0], "wrong": "x"}

    def update(self, measurement: Any, estimate: Any, reference: Any) -> list[Any]:
        return [1.0, 2.0]


class Described:
    """A law that gets what a built-in law gets."""

    @section
    class Settings:
        gain: Positive = 1.0
        soft: bool = False

    def __init__(self, settings: Any, plant: PlantDescription) -> None:
        self.settings, self.plant = settings, plant

    def update(self, measurement: Any, estimate: Any, reference: Any) -> Any:
        return np.zeros(2)


class Broken(Steady):
    """A law that breaks at tick 20 as its settings say."""

    def update(self, measurement: Any, estimate: Any, reference: Any) -> Any:
        if measurement.tick < 20:
            return np.zeros(2)
        return {
            "raises": lambda: 1 / 0,
            "shape": lambda: np.zeros(3),
            "nothing": lambda: None,
            "words": lambda: "full speed",
            "finite": lambda: np.array([0.0, np.nan]),
            "masked": lambda: np.ma.masked_less(np.zeros(2), 1.0),
            "terms": self.unclear,
            "slow": self.slow,
        }[self.settings["how"]]()

    def unclear(self) -> Any:
        self.terms = {"unclear": Unclear()}
        return np.zeros(2)

    @staticmethod
    def slow() -> Any:
        return np.full(2, sum(0.0 for _ in range(200_000)))


class Unclear:
    """What is no array after all."""

    def __array__(self, *args: Any, **keys: Any) -> Any:
        raise RuntimeError("no terms today")


class BrokenEstimator:
    def reset(self, measurement: Any) -> None:
        pass

    def update(self, measurement: Any) -> Estimate:
        if measurement.tick >= 20:
            raise RuntimeError("lost my\nbearings")
        none = np.zeros(0)
        return Estimate(np.zeros(2), np.zeros(2), none, np.zeros((0, 0)), none)


RAISED = '            raise RuntimeError("lost my\\nbearings")'


class Estimating(Steady):
    estimator = BrokenEstimator()


class Incomplete:
    def __init__(self, settings: Any, period: Any, effort_limit: Any) -> None:
        if settings:
            raise ValueError("kp must be positive")


HERE = f"{__file__}:"
REASONS = {
    "masked": "is masked",
    "terms": "no terms today",
    "raises": "ZeroDivisionError",
    "shape": "shape (3,), expected (2,)",
    "nothing": "shape (), expected (2,)",
    "words": "ValueError",
    "finite": "not finite",
    "slow": "time_limit is 0.1 ms",
}


def controller(name: Any, law: Any, **values: Any) -> Any:
    return build_controller(name, law, values, plant(0.01, LIMIT), "test")


def flown(mine: Any, duration: float = 1.0, **more: Any) -> tuple[Any, Any]:
    values = {
        "testbed": {"modes": 1, "initial": {"hub_pitch": 0.1}},
        "duration": duration,
        "active": "mine",
        "fallback": ["pd_feedforward"],
        **more,
    }
    bench = Bench(validated(BenchSettings, values, "test"))
    spare = controller("pd_feedforward", "pd_feedforward")
    run_bench(bench, {"mine": mine, "pd_feedforward": spare})
    return bench, list(bench.events)


def only(events: Any, kind: Any) -> Any:
    (event,) = [e for e in events if e.kind == kind]
    return event


def test_the_documented_example_flies_as_the_built_in_law_to_the_bit() -> None:
    entries = [{"at": 0.1, "disturbance": {"base_yaw": 5.0}}]
    mine, events = flown(controller("mine", EXAMPLE), 5.0, schedule=entries)
    built_in, _ = flown(controller("mine", "pd_feedforward"), 5.0, schedule=entries)
    assert np.array_equal(mine.truth().position, built_in.truth().position)
    assert mine.truth().position[0] != 0.0
    assert not [e for e in events if e.level is not Level.INFO]


def test_the_page_shows_the_example_as_it_is() -> None:
    page = (ROOT / "docs" / "own_controller.md").read_text()
    code = Path(EXAMPLE.removesuffix(":MyLaw")).read_text()
    lines = [line for line in code[code.index("class") :].splitlines() if '"""' not in line]
    shown = page[page.index("```python") + 10 :].split("```")[0]
    assert [line for line in shown.splitlines() if line] == [line for line in lines if line]


def test_a_law_gets_its_settings_the_period_and_the_limits() -> None:
    built = controller("mine", HERE + "Steady", gain=3.0, handover_time=0.5, time_limit=1.0)
    law = built._law._built
    assert (law.settings, law.period) == ({"gain": 3.0}, 0.01)
    assert law.effort_limit.tolist() == list(LIMIT)
    zero = np.zeros(2)
    answer = built.observe(Measurement(0, 0, 0.0, "mine", zero, zero, zero, zero, zero))
    assert answer.command.effort.tolist() == [1.0, 2.0]
    assert [(name, term.tolist()) for name, term in answer.terms.items()] == [
        ("steady", [1.0, 2.0])
    ]
    values = {"gain": 3.0, "handover_time": 0.5}
    logged = load_yaml(settings_text(built, HERE + "Steady", values), "log")
    digest = sha256(Path(__file__).read_bytes()).hexdigest()
    assert logged == {**values, "computed": {}, "law_sha256": digest}


def test_a_class_with_settings_gets_them_validated_and_the_plant() -> None:
    built = controller("mine", HERE + "Described", gain="1e3", handover_time=0.5)._law._built
    assert (built.settings.gain, built.settings.soft) == (1000.0, False)
    assert built.plant.joint_names == JOINTS
    assert built.plant.testbed.model().joint_names == JOINTS


@pytest.mark.parametrize("wrong", [{"gian": 2.0}, {"gain": -1.0}, {"gain": "stiff"}])
def test_a_setting_that_such_a_class_does_not_have_is_refused(wrong: dict[str, Any]) -> None:
    (key,) = wrong
    with pytest.raises(BadInput, match=key) as refused:
        controller("mine", HERE + "Described", **wrong)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("how", REASONS)
def test_a_broken_law_is_named_replaced_and_the_run_goes_on(how: Any) -> None:
    limit = {"time_limit": 1e-4} if how == "slow" else {}
    mine = controller("mine", HERE + "Broken", how=how, **limit)
    bench, events = flown(mine)
    said = only(events, "not_ready")
    assert said.tick == 20
    assert said.data["controller"] == "mine"
    assert "Broken" in said.data["reason"]
    assert REASONS[how] in said.data["reason"]
    assert "\n" not in said.message
    assert str(mine.reason) == said.data["reason"]
    fallback = only(events, "fallback")
    assert fallback.tick == 20 + MAX_MISSED - 1
    assert (fallback.data["from"], fallback.data["to"]) == ("mine", "pd_feedforward")
    assert bench.done
    assert mine.last_tick == 99  # it is still shown every tick


def test_a_broken_estimator_is_named_too() -> None:
    mine = controller("mine", HERE + "Estimating")
    _, events = flown(mine)
    reason = only(events, "not_ready").data["reason"]
    line = 1 + Path(__file__).read_text().splitlines().index(RAISED)
    assert "RuntimeError: lost my bearings (" in reason
    assert reason.endswith(f"test_user_law.py, line {line})")
    assert only(events, "fallback").tick == 20 + MAX_MISSED - 1


@pytest.mark.parametrize(
    ("law", "channel", "keys"),
    [
        ("pd_feedforward", "joint_position", {}),
        ("output_feedback", "joint_position", {}),
        ("proportional_integral", "joint_position", {}),
        ("lqr", "tip_deflection", {"filter": {"tip_sigma": 1e-4}}),  # begins without tips
    ],
)
def test_a_law_is_silent_while_a_sensor_reads_nan_and_is_back_after_it(
    law: str, channel: str, keys: dict[str, Any]
) -> None:
    fault = {"kind": "sensor_nan", "channel": channel}
    entries = [{"at": 0.2, "until": 0.23, "fault": fault}]
    mine = controller("mine", law, **keys)
    bench, events = flown(mine, schedule=entries, allow_faults=True)
    assert [e.tick for e in events if e.kind == "missed"] == [20, 21, 22]
    said = [e for e in events if e.data.get("controller") == "mine"]
    assert [e.tick for e in said if e.kind in ("not_ready", "ready")] == [20, 23]
    assert mine.reason is None
    assert bench.drive.active == "mine"
    assert np.isfinite(bench.truth().applied_effort).all()


def test_a_sensor_that_reads_nan_is_not_held_against_a_users_law() -> None:
    fault = {"kind": "sensor_nan", "channel": "joint_velocity"}
    entries = [{"at": 0.2, "until": 0.23, "fault": fault}]
    mine = controller("mine", EXAMPLE)
    bench, _ = flown(mine, schedule=entries, allow_faults=True)
    assert (mine.reason, bench.drive.active) == (None, "mine")


@pytest.mark.parametrize(
    ("law", "words"),
    [
        ("pid", "pid is not a law; allowed: .*pd_feedforward.*my_law.py:MyLaw"),
        ("nowhere.py:MyLaw", "cannot be loaded: ImportError: nowhere.py: No such file"),
        (HERE + "Nobody", "cannot be loaded: AttributeError"),
        (HERE + "ROOT", "a class is needed"),
        ("no_such_package.MyLaw", "cannot be loaded: ModuleNotFoundError"),
        (HERE + "Incomplete", "has no method update"),
    ],
)
def test_a_law_that_is_not_there_is_refused_with_the_reason(law: Any, words: str) -> None:
    with pytest.raises(BadInput, match=f"test: .*{words}"):
        controller("mine", law)


def test_the_hash_of_a_modules_law_is_that_of_the_code_that_flies(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    file, law = tmp_path / "laws_that_change.py", "laws_that_change.MyLaw"
    text = Path(EXAMPLE.rpartition(":")[0]).read_text()
    file.write_text(text)
    controller("mine", law)
    flies = sha256(text.encode()).hexdigest()
    assert own_code.code_hash(law) == flies
    file.write_text(text + "# another\n")
    controller("mine", law)  # Python imports a module once
    assert own_code.code_hash(law) == flies
    importlib.reload(sys.modules["laws_that_change"])
    controller("mine", law)
    assert own_code.code_hash(law) == sha256(file.read_bytes()).hexdigest() != flies


def test_a_law_that_refuses_its_settings_is_heard() -> None:
    with pytest.raises(BadInput, match="cannot be built: ValueError: kp must be positive"):
        controller("mine", HERE + "Incomplete", kp=-1.0)
    with pytest.raises(BadInput, match="time_limit"):
        controller("mine", HERE + "Steady", time_limit=-1.0)


def test_a_module_and_an_entry_point_serve_as_well(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "wheels_of_mine.py").write_text(Path(EXAMPLE.removesuffix(":MyLaw")).read_text())
    monkeypatch.syspath_prepend(str(tmp_path))
    point = EntryPoint("mine", "wheels_of_mine:MyLaw", LAWS)
    monkeypatch.setattr(own_code, "entry_points", lambda group: [point])
    by_module = user_law.find_law("wheels_of_mine.MyLaw", "test", (), ANY_CODE)
    assert by_module.__name__ == "MyLaw"
    assert user_law.find_law("mine", "test", (), NO_CODE) is by_module


def test_a_package_that_is_installed_meanwhile_is_found(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(BadInput, match="late is not a law"):
        user_law.find_law("late", "test", (), NO_CODE)
    (tmp_path / "late_wheels.py").write_text(Path(EXAMPLE.removesuffix(":MyLaw")).read_text())
    (tmp_path / "late-1.0.dist-info").mkdir()
    (tmp_path / "late-1.0.dist-info/METADATA").write_text("Name: late\nVersion: 1.0\n")
    words = f"[{LAWS}]\nlate = late_wheels:MyLaw\n"
    (tmp_path / "late-1.0.dist-info/entry_points.txt").write_text(words)
    later = tmp_path.stat().st_mtime_ns + 10**9  # a tick of the file system's clock and more
    os.utime(tmp_path, ns=(later, later))
    assert user_law.find_law("late", "test", (), NO_CODE).__name__ == "MyLaw"
    assert own_code.file_of("late") == tmp_path / "late_wheels.py"


class Counting(Steady):
    """A law whose answer depends on how often it was asked."""

    def __init__(self, settings: Any, period: Any, effort_limit: Any) -> None:
        super().__init__(settings, period, effort_limit)
        self.request = 0

    def update(self, measurement: Any, estimate: Any, reference: Any) -> list[Any]:
        self.request += 1
        HEARD.append(measurement.tick)
        if self.settings.get("raises"):
            raise RuntimeError("not in the mood")
        return [float(self.request), 0.0]


HEARD: list[Any] = []


@pytest.mark.parametrize("raises", [False, True])
def test_a_controller_is_warm_without_having_moved(raises: bool) -> None:
    mine = controller("mine", HERE + "Counting", raises=raises)
    mine.warm(2)
    assert mine.law._built.update.__globals__["HEARD"]
    assert (mine.reason, mine.last_tick) == (None, -1)
    zero = np.zeros(2)
    answer = mine.observe(Measurement(0, 0, 0.0, "mine", zero, zero, zero, zero, zero))
    if raises:
        assert answer is None
    else:
        assert answer.command.effort[0] == 1.0
