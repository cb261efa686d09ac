"""Every entry that takes YAML refuses, in one line and at once, a few lines that stand for much."""

import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from flexslew_control.law import plant_description
from flexslew_control.message_fields import plan_of
from flexslew_control.plan_service.planning import plan_request
from flexslew_control.plans.plan_file import load_plan
from flexslew_control.ros.planner_settings import PlannerSettings
from flexslew_lab import notebook
from flexslew_lab.cli.replay import _settings
from flexslew_lab.console.current_trial import current_trial, settings_of
from flexslew_lab.console.forms import FormKey, value_of
from flexslew_lab.log.messages.logged_text import logged_yaml
from flexslew_lab.report.runs_index import runs_in
from flexslew_lab.studies.study import load_study, parse_study
from flexslew_lab.trial.sources import changes_of, read_trial
from flexslew_lab.trial.trial import load_trial, parse_trial
from flexslew_plant.bench.requested_yaml import requested_yaml
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import NO_CODE
from flexslew_plant.refusal import Refusal
from flexslew_plant.system_file import system_from_file
from flexslew_plant.testbeds.model_file import with_model_file
from flexslew_plant.testbeds.spacecraft.shapes.modal_file import modal_shape
from flexslew_plant.yaml_data import load_yaml

LEVELS = range(1, 12)


def grown(first: str, line: str) -> str:
    """Return a text in which every line names the one before nine times."""
    rows = (line.format(k=k, before=", ".join([f"*a{k - 1}"] * 9)) for k in LEVELS)
    return "\n".join((f"a0: &a0 {first}", *rows))


CALLS = (
    10_000_000  # and returns, some seconds; a text that is expanded takes thousands of times more
)
NAMES = ", ".join(f"k{k}: 1" for k in range(500))
BOMBS = {
    "merges": grown("{x: 1}", "a{k}: &a{k} {{<<: [{before}]}}"),
    "merges of other keys": grown("{x: 1}", "a{k}: &a{k} {{<<: [{before}], x{k}: 1}}"),
    "many merges": f"a0: &a0 {{{NAMES}}}\nb: {{<<: [{', '.join(['*a0'] * 500)}]}}",
    "merge keys": f"a0: &a0 {{{NAMES}}}\n" + "\n".join(f"b{k}: {{<<: *a0}}" for k in range(500)),
    "lists": grown("[1, 1]", "a{k}: &a{k} [{before}]"),
    "mappings": "a0: &a0 {x: 1}\n"
    + "\n".join(f"a{k}: &a{k} {{b: *a{k - 1}, c: *a{k - 1}, d: *a{k - 1}}}" for k in range(1, 16)),
    "texts": f"a0: &a0 {'x' * 10_000}\nb: [{', '.join(['*a0'] * 2000)}]",
    "keys": f"a0: &a0 {{{'x' * 10_000}: 1}}\nb: [{', '.join(['*a0'] * 2000)}]",
    "recursion": "a0: &a0 {b: [*a0, *a0]}",
    "depth": "a0: " + "[" * 200_000,
    "short depth": "a0: " + "[" * 4000 + "]" * 4000,
    "digits": "a0: " + "9" * 5000,
    "hexadecimal digits": "a0: [0x" + "f" * 6000 + "]",
}


SMALL = {"merges", "merges of other keys"}  # equal keys are merged once: few are left


def from_file(read: Callable[[Path], object], ending: str = ".yaml") -> Callable[[str, Path], Any]:
    def entry(text: str, folder: Path) -> object:
        path = folder / f"given{ending}"
        path.write_text(text)
        return read(path)

    return entry


def of_text(read: Callable[[str], object]) -> Callable[[str, Path], Any]:
    return lambda text, folder: read(text)


def refused(found: object) -> None:
    if isinstance(found, Refusal):
        raise BadInput(found)


class PlanMessage(SimpleNamespace):
    """A plan of no tick."""

    def __getattr__(self, name: str) -> Any:
        """Return a field that is not given."""
        return 0.0 if name in {"start", "period"} else []


def index(path: Path) -> None:
    """Read the list of runs, which leaves out what cannot be read."""
    run = path.parent / "runs" / "one"
    run.mkdir(parents=True, exist_ok=True)
    (run / "metrics.json").write_text("{}")
    path.rename(run / "trial.yaml")
    _, unread = runs_in(run.parent)
    raise BadInput(str(unread))


VIEW = {"controllers": {"a": SimpleNamespace(law="", settings="")}}
ENTRIES = {
    "text": of_text(lambda text: load_yaml(text, "text")),
    "request of an operator": of_text(lambda text: requested_yaml(text, "request")),
    "log": of_text(lambda text: logged_yaml(text, "log")),
    "plan in a log": of_text(
        lambda text: plan_of(PlanMessage(joint_names=["a"], request=text), "log")
    ),
    "testbed record": of_text(lambda text: plant_description(text, "testbed")),
    "plan request": of_text(lambda text: refused(plan_request(text, "", 0.01, (1.0,)))),
    "law of the planner": of_text(lambda text: PlannerSettings(law_settings=text).first_law()),
    "--set of a trial": of_text(lambda text: changes_of([f"testbed={{{text}}}"])),
    "--set of a check": of_text(lambda text: _settings([f"kp={text}"])),
    "form": of_text(lambda text: value_of(FormKey("kp", "", ""), text)),
    "settings on the console": of_text(settings_of),
    "bench on the console": of_text(
        lambda text: current_trial(SimpleNamespace(**VIEW, trust=NO_CODE, bench_settings=text), "a")  # type: ignore[arg-type]
    ),
    "text of a trial": of_text(lambda text: parse_trial(text, "trial")),
    "text of a study": of_text(lambda text: parse_study(text, "study", Path())),
    "trial": from_file(load_trial),
    "trial of the command line": from_file(read_trial),
    "trial of a notebook": from_file(notebook.trial),
    "study": from_file(load_study),
    "plan": from_file(load_plan),
    "model": from_file(lambda path: with_model_file({"file": str(path)}, "model")),
    "linear law": from_file(lambda path: system_from_file(str(path), "law")),
    "modal data": from_file(modal_shape),
    "head of modal data": from_file(
        lambda path: modal_shape(_commented(path)), ending=".csv"
    ),
    "list of runs": from_file(index),
}  # fmt: skip


def _commented(path: Path) -> Path:
    path.write_text("".join(f"# {line}\n" for line in path.read_text().splitlines()))
    return path


@contextmanager
def at_most(most: int, name: str) -> Iterator[None]:
    """Fail if more functions are called than are allowed: a time would depend on the machine."""
    count = 0

    def add(*_: object) -> None:
        nonlocal count
        count += 1

    sys.setprofile(add)
    try:
        yield
    finally:
        sys.setprofile(None)
    assert count <= most, f"{name}: {count} calls"


@pytest.mark.first(3)
@pytest.mark.parametrize("entry", ENTRIES)
def test_an_entry_refuses_every_bomb_at_once(entry: str, tmp_path: Path) -> None:
    for name, text in BOMBS.items():
        words = ""
        with at_most(CALLS, name):
            try:
                ENTRIES[entry](text, tmp_path)
            except BadInput as error:
                words = str(error)
        if not words:
            assert name in SMALL
            continue
        assert len(words.splitlines()) == 1, name
        assert len(words) < 3100, name


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a: &a {x: 1}\nb: [&b {<<: *a, y: 2}]\nc: {<<: *b, y: 3}", {"x": 1, "y": 3}),
        ("a: &a {x: 1}\nb: &b {x: 2, y: 2}\nc: {<<: [*a, *b]}", {"x": 1, "y": 2}),
        ("a: &a {x: 1}\nb: &b {x: 2, y: 2}\nc: {<<: *a, <<: *b}", {"x": 2, "y": 2}),
        ("c: &a {<<: *a, x: 1}", {"x": 1}),
    ],
)
def test_merges_are_read_as_yaml_defines_them(text: str, expected: dict[str, int]) -> None:
    assert load_yaml(text, "t")["c"] == expected


@pytest.mark.parametrize("value", ["1", "[*a, 1]", "text"])
def test_only_mappings_are_merged(value: str) -> None:
    with pytest.raises(BadInput, match=r"^t: line 2, column \d+ is not YAML: << merges mappings"):
        load_yaml(f"a: &a {{x: 1}}\nb: {{<<: {value}}}", "t")


def test_yaml_is_read_in_one_place() -> None:
    sources = Path(__file__).parents[2] / "ros2_ws" / "src"
    readers = re.compile(r"yaml\.(\w+_)?(load|parse|scan|compose)\w*\(|\w*Loader\b.*yaml")
    found = [p.name for p in sources.rglob("*.py") if readers.search(p.read_text())]
    assert found == ["yaml_data.py"]
