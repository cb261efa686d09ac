import pickle

import pytest

from flexslew_plant.errors import BadInput, FlexslewError
from flexslew_plant.own_code import LAWS, NO_CODE, Untrusted, find_class
from flexslew_plant.refusal import Cause, Refusal, one_line


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


@pytest.mark.slow
@pytest.mark.parametrize("text", ["x" * 10_000_000, "x " * 5_000_000, "\n" * 10_000_000])
def test_a_long_value_makes_no_long_message(text: str) -> None:
    for error in (
        BadInput(f"{text} is not a law; allowed: lqr", "trial.yaml", "law"),
        BadInput("a name", "trial.yaml", "law", text),
        BadInput("a name", text, "law"),
        BadInput("a name", "trial.yaml", text, 1),
        FlexslewError(f"{text} is not here"),
    ):
        assert len(str(error)) < 4000
    assert "allowed: lqr" in str(BadInput(f"{'x' * 10_000} is not a law; allowed: lqr"))
    assert one_line("a word of " + "x" * 300) == "a word of " + "x" * 300


def test_the_command_that_a_refusal_names_is_quoted_for_the_shell() -> None:
    name = "a.py; touch X; #.py:MyLaw"
    with pytest.raises(Untrusted) as caught:
        find_class(name, LAWS, "law", "log", (), NO_CODE)
    assert f"--trust '{name}'" in str(caught.value)
