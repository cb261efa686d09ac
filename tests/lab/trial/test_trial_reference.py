"""The tables of keys in the pages are those of the code; the example of trial.md is a trial."""

import importlib.util
import re
import shlex
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pytest

from flexslew_control.controllers import CONTROLLERS, CommonSettings
from flexslew_control.planners import PLANNERS
from flexslew_lab.benchmark.task_settings import TaskSettings
from flexslew_lab.studies.study_settings import StudySettings
from flexslew_lab.trial.sources import read_trial
from flexslew_lab.trial.trial import Trial, parse_trial
from flexslew_lab.tuning.settings import TuningSettings
from flexslew_plant.keys.settings_fields import describe_section

DOCS = Path(__file__).parents[3] / "docs"
TEXT = (DOCS / "trial.md").read_text()
SPEC = importlib.util.spec_from_file_location("key_tables", DOCS / "key_tables.py")
assert SPEC is not None
assert SPEC.loader is not None
key_tables = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(key_tables)
IN_FAULTS = "flexslew_plant.faults"  # in the table of their kinds
FORMS = {"Sine", "Pulse"}  # of one key, which faults/kinds.md shows


def sections(kind: Any) -> set[type[Any]]:
    """Return all sections that a type holds, itself included."""
    if isinstance(kind, type) and is_dataclass(kind):
        hints = get_type_hints(kind, include_extras=True)
        inner = [sections(hints[item.name]) for item in fields(kind) if item.repr]
        return {kind}.union(*inner)
    return set[type[Any]]().union(*(sections(part) for part in get_args(kind)))


KINDS = (
    Trial,
    StudySettings,
    TaskSettings,
    TuningSettings,
    CommonSettings,
    *(e.settings for e in CONTROLLERS.values()),
)
SECTIONS = sorted(set().union(*map(sections, KINDS)), key=lambda kind: kind.__name__)


@pytest.mark.parametrize("page", key_tables.PAGES, ids=lambda page: page.name)
def test_the_tables_of_a_page_are_those_of_the_code(page: Path) -> None:
    text = page.read_text()
    assert key_tables.current(text) == text, (
        "run: . setup/environment.sh; python docs/key_tables.py"
    )


def test_every_section_has_its_table() -> None:
    assert len(SECTIONS) > 50
    shown = {
        key_tables.section_of(*names)
        for page in key_tables.PAGES
        for names in key_tables.MARK.findall(page.read_text())
    }
    apart = {
        kind for kind in SECTIONS if kind.__module__.startswith(IN_FAULTS) or kind.__name__ in FORMS
    }
    assert not set(SECTIONS) - shown - apart


@pytest.mark.parametrize("kind", SECTIONS, ids=lambda kind: kind.__name__)
def test_every_key_is_described_in_its_field(kind: type[Any]) -> None:
    fixed = ("kind", "method", "goal")  # select the section
    meanings = describe_section(kind)
    bare = [f.name for f in fields(kind) if f.repr and not meanings[f.name].description]
    assert not set(bare) - set(fixed)


def test_every_planner_and_law_has_its_page_and_its_row() -> None:
    for folder, table in (("planners", PLANNERS), ("controllers", CONTROLLERS)):
        assert {page.stem for page in (DOCS / folder).glob("*.md")} == set(table)
        rows = re.findall(rf"^\| \[(\w+)\]\({folder}/\1\.md\)", TEXT, re.MULTILINE)
        assert sorted(rows) == sorted(table)


def example(page: Path) -> Trial:
    """Return the trial that the command of a page flies."""
    command = re.search(r"^\./flexslew trial (.*)$", page.read_text(), re.MULTILINE)
    assert command is not None
    name, *words = shlex.split(command[1])
    assert set(words[::2]) <= {"--set"}
    return read_trial(name, words[1::2])[0]


@pytest.mark.parametrize("name", CONTROLLERS)
def test_the_example_of_a_law_flies_it(name: str) -> None:
    trial = example(DOCS / f"controllers/{name}.md")
    named = {(own or {}).get("law", key) for key, own in trial.controllers.items()}
    assert name in named


@pytest.mark.parametrize("name", PLANNERS)
def test_the_example_of_a_planner_flies_its_plan(name: str) -> None:
    plan: Any = example(DOCS / f"planners/{name}.md").plan
    assert plan.method == name


def test_a_stale_table_is_found() -> None:
    line = next(line for line in TEXT.splitlines() if line.startswith("| period |"))
    assert key_tables.current(TEXT.replace(line, "| period | 0.02 | a lie |")) == TEXT


def test_the_example_is_a_trial() -> None:
    example = re.search(r"```yaml\n(.*?)```", TEXT, re.DOTALL)
    assert example is not None
    assert parse_trial(example[1], "docs/trial.md").name == "my_slew"
