import json
from typing import Any

import pytest
from rich.console import Console

from flexslew_lab.cli import terminal
from flexslew_lab.cli.summary import metric_rows
from flexslew_lab.metrics.from_bag import metrics_of

UNITS = {"base_yaw": "rad", "hub_pitch": "rad"}


def test_every_number_has_its_own_unit_and_row(bag: Any) -> None:
    metrics = metrics_of(bag)
    rows = {key: (value, unit) for key, value, unit in metric_rows(metrics, UNITS)}
    assert rows["peak_effort.base_yaw"] == ("40", "N m")
    assert rows["settling_time.hub_pitch"][1] == "s"
    assert rows["final_error.base_yaw"][1] == "rad"
    assert len(rows) > len(metrics)
    mixed = metric_rows({"final_error": {"x": 1.0, "y": 2.0}}, {"x": "m", "y": "rad"})
    assert [unit for _, _, unit in mixed] == ["m", "rad"]


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
