from typing import Any

import pytest

from flexslew_lab.run.launch_arguments import ARGUMENTS, launch_values, nested_namespace
from flexslew_plant.errors import BadInput

DEFAULTS = {name: default for name, (default, _) in ARGUMENTS.items()}


def test_the_defaults_fly_the_default_trial_with_log_and_report() -> None:
    values = launch_values(DEFAULTS | {"of_the_file_that_includes_it": "1"})
    assert (values.rate, values.out, values.controllers) == (None, None, ())
    assert values.record
    assert values.report
    assert values.shutdown


def test_what_is_given_is_taken() -> None:
    given = {"rate": "2", "controllers": "lqr, pd_feedforward", "record": "False", "out": "x"}
    values = launch_values(DEFAULTS | given)
    assert (values.rate, values.record, str(values.out)) == (2.0, False, "x")
    assert values.controllers == ("lqr", "pd_feedforward")


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"rate": "-1"}, "rate: -1 is not allowed"),
        ({"rate": "fast"}, "rate: fast is not allowed"),
        ({"namespace": "bench 1"}, "launch: namespace: 'bench 1' is not allowed: letters"),
        ({"record": "maybe"}, "record: 'maybe' is not allowed: true or false"),
    ],
)
def test_a_wrong_value_is_told_in_one_line(given: Any, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        launch_values(DEFAULTS | given)


@pytest.mark.parametrize(
    ("group", "namespace", "expected"),
    [("", "", ""), ("", "b", "/b"), ("/a", "", "/a"), ("/a", "b", "/a/b"), ("/a", "/b", "/b")],
)
def test_a_namespace_is_within_that_of_a_group_unless_it_is_absolute(
    group: str, namespace: str, expected: str
) -> None:
    assert nested_namespace(group, namespace) == expected
