import json
from typing import Any

import pytest
from rich.console import Console

from flexslew_lab.cli import terminal
from flexslew_lab.cli.output.summary import metric_rows
from flexslew_lab.metrics.from_bag import metrics_of

UNITS = {"base_yaw": "rad", "hub_pitch": "rad"}


def test_every_number_has_its_own_unit_and_row(bag: Any) -> None:
    metrics = metrics_of(bag)
    rows = {row[0]: row[1:] for row in metric_rows(metrics, UNITS) if len(row) > 1}
    assert rows["peak_effort.base_yaw"] == ("40", "N m")
    assert rows["settling_time.hub_pitch"][1] == "s"
    assert rows["final_error.base_yaw"][1] == "rad"
    assert len(rows) > len(metrics)
    mixed = metric_rows({"final_error": {"x": 1.0, "y": 2.0}}, {"x": "m", "y": "rad"})
    assert mixed == [("motion",), ("final_error.x", "1", "m"), ("final_error.y", "2", "rad")]


def test_rows_come_in_groups_with_the_joints_in_one_order_and_numbers_of_four_digits() -> None:
    metrics = {
        "peak_effort": {"hub_pitch": 37.8482, "base_yaw": 77.861},
        "ticks": 3000,
        "final_error": {"base_yaw": -6.20672e-05, "hub_pitch": 0.0},
        "mine": 1.0,
    }
    assert metric_rows(metrics, UNITS) == [
        ("motion",),
        ("final_error.base_yaw", "-6.207e-05", "rad"),
        ("final_error.hub_pitch", "0", "rad"),
        ("effort",),
        ("peak_effort.base_yaw", "77.86", "N m"),
        ("peak_effort.hub_pitch", "37.85", "N m"),
        ("run",),
        ("ticks", "3000", ""),
        ("your metrics",),
        ("mine", "1", ""),
    ]


def test_a_table_of_metrics_in_a_pipe_has_at_most_100_columns_and_aligned_numbers(
    bag: Any, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    rows = [*metric_rows(metrics_of(bag), UNITS), ("warnings", "word " * 60, "")]
    terminal.print_table(("metric", "value", "unit"), rows, terminal.PIPED)
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 100
    efforts = [line for line in lines if "_effort.base_yaw" in line]
    assert len({line.rindex(" N m") for line in efforts}) == 1


def test_tables_fit_a_terminal_of_80_columns_and_keep_every_character(
    bag: Any, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    rows = metric_rows(metrics_of(bag), UNITS)
    terminal.print_table(("metric [s]", "value", "unit"), [*rows, ("note", "[red]x[/red] [m]", "")])
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) <= 80
    assert "metric [s]" in out
    assert "[red]x[/red] [m]" in out


@pytest.mark.parametrize("words", ["[/nothing]", "[s] [rad]", "a [bold]b", json.dumps(["x"])])
def test_what_is_said_is_said_as_it_is(
    words: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(terminal, "for_people", Console(stderr=True))
    terminal.print_message(words, head="error: ")
    assert capsys.readouterr().err == f"error: {words}\n"
