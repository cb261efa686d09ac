"""Rows of a reproduction say what their tolerance is of, and those off it fail the command."""

import json
from typing import Any

import pytest
from typer.testing import CliRunner

from flexslew_lab import reproduce
from flexslew_lab.cli.main import app
from flexslew_lab.reproduce.rows import absolute, at_most, difference_row, equal, relative

NEAR = [
    absolute("length [m]", "2.0", 2.0, 2.05, 0.1),
    relative("length [m]", "", 200.0, 210.0, 0.1),
    at_most("drift [-]", "", 1.0, 1.0),
    equal("settles", "", "never", "never"),
]
OFF = [
    absolute("length [m]", "", 200.0, 210.0, 0.1),
    relative("length [m]", "", 2.0, 2.3, 0.1),
    at_most("drift [-]", "", 1.0, 1.1),
    equal("settles", "", "never", 3.0),
]
APART = difference_row("peak [m]", "6.0", 6.0, "refused", "its law is unstable")


def flown(monkeypatch: pytest.MonkeyPatch, rows: list[Any], *options: str) -> tuple[int, str]:
    """Return exit code and words of the command for a paper of these rows."""
    module = type("Module", (), {"rows": staticmethod(lambda: rows)})
    monkeypatch.setattr(reproduce, "import_module", lambda name: module)
    for name in [*reproduce.REPRODUCTIONS]:
        monkeypatch.delitem(reproduce.REPRODUCTIONS, name)
    for name in ("one", "two"):
        paper = reproduce.Reproduction(name, name, "rows")
        monkeypatch.setitem(reproduce.REPRODUCTIONS, name, paper)
    done = CliRunner().invoke(app, ["reproduce", *options], env={"COLUMNS": "200"})
    return done.exit_code, done.output


def test_a_row_is_near_in_its_own_way() -> None:
    assert [row["ok"] for row in NEAR] == [True] * 4
    assert [row["ok"] for row in OFF] == [False] * 4


def test_what_is_not_reproduced_is_counted_and_does_not_fail(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    code, words = flown(monkeypatch, [*NEAR, APART], "one")
    assert code == 0
    assert "one: 4 of 5 within tolerance, 1 not reproduced" in words
    assert "not reproduced, because its law is unstable (peak [m])" in words
    for kind in ("0.1 absolute", "0.1 relative", "at most", "equal"):
        assert kind in words


@pytest.mark.parametrize("row", OFF)
def test_a_row_that_is_off_fails_the_command(
    monkeypatch: pytest.MonkeyPatch, row: dict[str, Any]
) -> None:
    code, words = flown(monkeypatch, [*NEAR, row], "two")
    assert code == 1
    assert "two: 4 of 5 within tolerance, 1 off" in words


def test_without_a_name_all_papers_are_computed(monkeypatch: pytest.MonkeyPatch) -> None:
    code, words = flown(monkeypatch, NEAR, "--json")
    assert code == 0
    found = json.loads(words)
    assert [*found] == ["one", "two"]
    assert [row["tolerance_is"] for row in found["one"]][:2] == ["absolute", "relative"]
