"""A number is a number wherever it is given: as Python, JSON and people write it."""

import json
from pathlib import Path
from typing import Any

import pytest

from flexslew_lab.console.forms import number_of
from flexslew_lab.studies.study import parse_study
from flexslew_lab.trial.sources import changes_of
from flexslew_lab.trial.trial import parse_trial
from flexslew_plant.yaml_data import load_yaml, yaml_text

WRITTEN = ("1e-5", "1e-05", "1E-5", "1.0e-5", "1.e-5", ".1e-4", "+1e-5", "0.00001", "1.0E-05")


@pytest.mark.parametrize("text", WRITTEN)
def test_every_way_to_write_it_is_the_number(text: str) -> None:
    for place in (f"{text}", f"[{text}]", f"{{a: {text}}}", f"- {text}\n- {text}\n"):
        found = load_yaml(place, "test")
        while isinstance(found, list | dict):
            found = next(iter(found.values() if isinstance(found, dict) else found))
        assert found == 1e-5, place
        assert isinstance(found, float)


@pytest.mark.parametrize("text", ["1e", "e5", "1e5x", "1-e5", "v1e5", "1.0.e5", "'1e5'"])
def test_what_only_looks_like_one_stays_a_text(text: str) -> None:
    assert isinstance(load_yaml(text, "test"), str)


@pytest.mark.parametrize("value", ["1e5", "1e-05", "1.0e3", "12e03", 1e-5, 1e22, -1e-300, 3, "a"])
def test_what_is_written_comes_back_as_the_type_that_it_was(value: Any) -> None:
    for text in (yaml_text([value]), yaml_text({"a": [value]}, flow=True), json.dumps([value])):
        found = load_yaml(text, "test")
        (back,) = found["a"] if isinstance(found, dict) else found
        assert (back, type(back)) == (value, type(value))


@pytest.mark.parametrize("text", WRITTEN)
def test_a_trial_a_study_and_a_form_take_it(text: str, tmp_path: Path) -> None:
    trial = parse_trial(f"{{duration: 1.0, period: {text}, plan: {{method: none}}}}", "test")
    assert trial.period == 1e-5
    own = f"{{controllers: {{a: {{law: my.py:Law, gain: {text}, gains: [{text}]}}}}, active: a}}"
    law = load_yaml(own, "test")["controllers"]["a"]
    assert (law["gain"], law["gains"]) == (1e-5, [1e-5])
    assert changes_of([f"period={text}"]) == {"period": 1e-5}
    study = parse_study(
        f"{{study: spread, trial: m1, sampling: {{method: random, n: 4}},"
        f" vary: {{testbed.damping_ratio: {{uniform: [{text}, 0.001]}}}}}}",
        "test",
        tmp_path,
    )
    spread = study.varied[0].distribution
    assert spread is not None
    assert spread.numbers == (1e-5, 0.001)
    assert number_of("field", load_yaml(text, "field")) == 1e-5
