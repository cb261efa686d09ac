import pickle

import pytest

from flexslew_plant.errors import BadInput
from flexslew_plant.refusal import Cause, Refusal


@pytest.mark.parametrize(
    ("refusal", "line"),
    [
        (
            Refusal("0 or more", "plan.duration", -1.0, "m1.yaml"),
            "m1.yaml: plan.duration: -1.0 is not allowed: 0 or more",
        ),
        (Refusal("give a number", "kp", "high"), "kp: 'high' is not allowed: give a number"),
        (Refusal("is missing", "kp", source="node pd"), "node pd: kp: is missing"),
        (Refusal("the brake is latched", cause=Cause.LATCHED), "the brake is latched"),
        (Refusal("no list", "x", None), "x: None is not allowed: no list"),
        (Refusal("breaks\nits line"), r"breaks\nits line"),
    ],
)
def test_a_refusal_is_one_line_of_the_parts_that_it_has(refusal: Refusal, line: str) -> None:
    assert str(refusal) == line
    assert str(BadInput(refusal)) == line
    assert BadInput(refusal).refusal is refusal


def test_a_long_value_is_cut() -> None:
    line = str(Refusal("at most 64", "names", ["name"] * 100))
    assert line.startswith("names: ['name', ")
    assert line.endswith("... is not allowed: at most 64")
    assert len(line) < 100


def test_a_refusal_of_a_part_names_its_place_in_the_whole() -> None:
    part = Refusal("0 or more", "kp", -1.0)
    assert str(part.within("controllers.pd", "a.yaml")).startswith(
        "a.yaml: controllers.pd.kp: -1.0"
    )
    assert part.within(source="b.yaml").key == "kp"
    assert Refusal("no", source="a").within("k").source == "a"


def test_a_refusal_says_the_same_in_another_process() -> None:
    for refusal in (Refusal("no"), Refusal("no", "k", None, "f", Cause.PAST)):
        again = pickle.loads(pickle.dumps(refusal))
        assert again == refusal
        assert str(again) == str(refusal)
    error = pickle.loads(pickle.dumps(BadInput(Refusal("no", "k"))))
    assert error.refusal == Refusal("no", "k")


def test_a_sentence_alone_is_a_refusal_too() -> None:
    assert BadInput("a.yaml: is no file").refusal == Refusal("a.yaml: is no file")
