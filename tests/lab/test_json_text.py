"""JSON and YAML that other programs and this one read again."""

import json
import re
from math import inf, nan
from pathlib import Path

import pytest

from flexslew_lab.json_text import json_text, nan_as_null
from flexslew_plant.yaml_data import load_yaml, yaml_text


@pytest.mark.parametrize("value", [nan, inf, -inf])
def test_a_number_that_is_not_finite_is_null(value: float) -> None:
    text = json_text({"a": [1.0, (value, 2)], "b": {"c": value}, "d": True})
    assert json.loads(text, parse_constant=pytest.fail) == {
        "a": [1.0, [None, 2]], "b": {"c": None}, "d": True,
    }  # fmt: skip


def test_nan_is_null_in_files_of_results_and_kept_in_settings() -> None:
    """A NaN among settings must reach the check that refuses it: null would be the default."""
    values = {"a": nan, "b": [nan, 1.5, -inf]}
    assert load_yaml(yaml_text(nan_as_null(values)), "t") == {"a": None, "b": [None, 1.5, -inf]}
    assert ".nan" in yaml_text(values)


def test_commands_print_json_by_one_function() -> None:
    folder = Path(__file__).parents[2] / "ros2_ws" / "src" / "flexslew_lab" / "flexslew_lab"
    found = [
        p.name for p in (folder / "cli").glob("*.py") if re.search(r"json\.dumps\(", p.read_text())
    ]
    assert found == ["schema.py"]  # of literals, with an indent of its own
