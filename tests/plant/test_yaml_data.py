"""What YAML gives, and what of it is refused."""

import pytest

from flexslew_plant.errors import BadInput
from flexslew_plant.yaml_data import bounded, load_yaml, yaml_text


@pytest.mark.parametrize(
    "text", ["017", "-08", "1:30", "1:30.5", "10:00:00", "2026-11-27", "2026-13-45"]
)
def test_what_yaml_1_1_takes_for_base_8_or_60_or_a_date_is_a_text(text: str) -> None:
    assert load_yaml(f"duration: {text}", "here") == {"duration": text}
    assert load_yaml(yaml_text({"name": text}), "here") == {"name": text}


def test_other_numbers_are_numbers() -> None:
    found = load_yaml("[0, -0.5, 10, 1e3, 0x10, 07.5, +3]", "here")
    assert found == [0, -0.5, 10, 1000.0, 16, 7.5, 3]


def test_yaml_has_no_aliases() -> None:
    shared = [1.0, 2.0]
    assert "&" not in yaml_text({"a": shared, "b": shared})


def test_a_syntax_error_names_the_line() -> None:
    with pytest.raises(BadInput, match=r"^trial\.yaml: line 3, column \d+ is not YAML"):
        load_yaml("a: 1\nb: [1, 2\nc: 3", "trial.yaml")


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("!!int abc", "'abc' is no int"),
        ("!!bool maybe", "'maybe' is no bool"),
        ("!!timestamp soon", "could not determine a constructor for the tag"),
        ("!!set {x, y}", "could not determine a constructor for the tag"),
        ("9" * 5000, "is no int"),
    ],
)
def test_a_value_that_yaml_cannot_make_is_refused_at_its_line(value: str, words: str) -> None:
    with pytest.raises(BadInput) as caught:
        load_yaml(f"a: 1\nb: [2, {value}]", "trial.yaml")
    assert str(caught.value).startswith("trial.yaml: line 2, column 8 is not YAML: ")
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "a: 1\nb: 2\na: 3",
            "trial.yaml: line 3, column 1 duplicate key a, first in line 1",
        ),
        ("a: {kp: 1,\n  kp: 2}", "line 2, column 3 duplicate key kp"),
        ("- {x: 1}\n- {x: 1, y: {z: 1, 'z': 2}}", "duplicate key z"),
    ],
)
def test_a_key_that_stands_twice_is_refused(text: str, words: str) -> None:
    with pytest.raises(BadInput) as caught:
        load_yaml(text, "trial.yaml")
    assert words in str(caught.value)


def test_equal_keys_of_different_sections_and_merges_are_read() -> None:
    text = "a: &a {x: 1, y: 2}\nb: {<<: *a, x: 3}\nc: [{x: 1}, {x: 1}]"
    assert load_yaml(text, "t")["b"] == {"x": 3, "y": 2}


LAUGHS = "a0: &a0 [1, 1]\n" + "".join(f"a{k}: &a{k} [*a{k - 1}, *a{k - 1}]\n" for k in range(1, 31))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("&x [*x]", "or is recursive"),
        ("a: &x {b: [1, *x, *x]}", "or is recursive"),
        ("[" * 33 + "]" * 33, "is nested more than 32 deep"),
        ("[" * 250_000, "is nested more than 32 deep"),
        ("- " * 100_000, "is nested more than 32 deep"),
        ("a: &a " + "[" * 20 + "]" * 20 + "\nb: " + "[" * 20 + "*a" + "]" * 20, "than 32 deep"),
        (LAUGHS.replace("a30: ", "b: "), "holds more than 1000000 values"),
    ],
)
def test_what_cannot_be_walked_through_is_refused(text: str, words: str) -> None:
    with pytest.raises(BadInput, match=r"^trial\.yaml: ") as caught:
        load_yaml(text, "trial.yaml")
    assert words in str(caught.value)


def test_aliases_and_nesting_within_the_limits_are_read() -> None:
    assert load_yaml("a: &a [1, 2]\nb: [*a, *a]", "t")["b"] == [[1, 2], [1, 2]]
    assert load_yaml("[" * 32 + "]" * 32, "t")


@pytest.mark.slow
def test_a_plan_or_table_of_more_than_a_million_honest_values_is_no_bomb() -> None:
    values = [[0.0, 0.0]] * 600_000
    assert bounded(values, "t", 10_000_000) is values
    with pytest.raises(BadInput, match="more than 1000000 values"):
        bounded(values, "t", 1000)
