"""Classes that are named as a testbed and are none: one line that says what they lack."""

from pathlib import Path

import pytest

from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import ANY_CODE
from flexslew_plant.testbeds import read_testbed

CLASSES = {
    "Bare": "class Bare:\n    kind: str = ''\n",
    "Arrays": """
import numpy as np
from flexslew_plant.settings import section
from flexslew_plant.testbeds.oscillators.floating_oscillator import FloatingOscillatorTestbed

class Thing:
    pass

class Arrays(FloatingOscillatorTestbed):
    thing: Thing

Arrays = type("Arrays", (), {"__annotations__": {"thing": Thing}, "effort_limit": (1.0,),
                             "model": 0, "modes": 1, "scene": 0})
""",
    "Later": """
class Later:
    effort_limit = (1.0,); model = 0; modes = 1; scene = 0
    @classmethod
    def __get_pydantic_core_schema__(cls, source, handler):
        return handler.generate_schema("NotDefined")
""",
}


@pytest.mark.parametrize("name", CLASSES)
def test_a_class_that_is_no_testbed_is_refused_in_one_line(tmp_path: Path, name: str) -> None:
    path = tmp_path / "mine.py"
    path.write_text(CLASSES[name])
    with pytest.raises(BadInput) as refused:
        read_testbed({"kind": f"{path}:{name}"}, "trial.yaml", ANY_CODE)
    assert name in str(refused.value)


@pytest.mark.parametrize("kind", ["builtins.dict", "builtins.int", "pathlib.Path"])
def test_a_class_of_the_library_is_no_testbed(kind: str) -> None:
    with pytest.raises(BadInput, match="is no testbed: it lacks effort_limit, model, modes, scene"):
        read_testbed({"kind": kind}, "trial.yaml", ANY_CODE)
