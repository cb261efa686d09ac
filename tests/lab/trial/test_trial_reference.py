"""docs/trial.md and docs/spacecraft.md tell every key of a trial file; the example is one."""

import re
from pathlib import Path
from typing import Any

import pytest
from pydantic import TypeAdapter

from flexslew_control.controllers import CONTROLLERS
from flexslew_lab.trial.trial import Trial, parse_trial

DOCS = Path(__file__).parents[3] / "docs"
TEXT = (DOCS / "trial.md").read_text()
TOLD = TEXT + (DOCS / "spacecraft.md").read_text()
ROWS = set(re.findall(r"^\| (\w+) \| [^|]+ \| [^|]*\w[^|]* \|$", TOLD, re.MULTILINE))


def keys_of(kind: Any) -> Any:
    schema = TypeAdapter(kind).json_schema()
    sections = {"": schema, **schema.get("$defs", {})}
    return {
        key
        for name, one in sections.items()
        if not is_told_in_faults(name)
        for key in one.get("properties", {})
    }


def is_told_in_faults(name: Any) -> Any:
    first = ("Actuator", "Command", "Sensor", "Controller", "Sine", "Pulse")
    return name.startswith(first) and name not in ("ActuatorSettings", "SensorSettings")


def test_every_key_of_a_trial_is_told_with_its_meaning() -> None:
    assert keys_of(Trial) - ROWS == set()


@pytest.mark.parametrize("law", CONTROLLERS)
def test_every_key_of_a_controller_is_told(law: Any) -> None:
    assert keys_of(CONTROLLERS[law].settings) - ROWS == set()


def test_every_planner_and_law_has_its_heading() -> None:
    methods = set(re.findall(r"^### method: (\w+)$", TEXT, re.MULTILINE))
    text = str(TypeAdapter(Trial).json_schema())
    assert methods == set(re.findall(r"'method': \{'const': '(\w+)'", text))
    assert set(re.findall(r"^### (\w+)$", TEXT, re.MULTILINE)) == set(CONTROLLERS)


def test_the_example_is_a_trial() -> None:
    example = re.search(r"```yaml\n(.*?)```", TEXT, re.DOTALL)
    assert parse_trial(example[1], "docs/trial.md").name == "my_slew"
