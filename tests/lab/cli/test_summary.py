import json
from typing import Any

import pytest
from rich.console import Console

from flexslew_lab.cli import terminal
from flexslew_lab.cli.summary import headline, metric_rows
from flexslew_lab.metrics.from_bag import metrics_of

UNITS = {"base_yaw": "rad", "hub_pitch": "rad"}


def test_the_headline_says_what_feedforward_is_worth() -> None:
    with_it, without = {"residual_tip_deflection": 0.01248}, {"residual_tip_deflection": 4.9712}
    words = "tip deflection after the manoeuvre: 0.0125 m"
    assert headline(with_it, without, 0.1) == f"{words}, without feedforward 4.97 m"
    assert headline(with_it, {}, 0.1) == words
    cut = {"residual_tip_deflection": None, "peak_tip_deflection": 5.3}
    assert headline(cut, {}, 0.1) == "tip deflection up to 5.3 m; the manoeuvre was not completed"


def test_a_missed_goal_is_told_before_the_tip() -> None:
    metrics = {"residual_tip_deflection": 0.0, "goal_error": 1.0, "final_error": {"mass": -0.2}}
    missed = "goal missed by 100 % of the commanded move (goal_tolerance 10 %); final error: mass"
    told = headline(metrics, {}, 0.1)
    assert told == f"{missed} -0.2; tip deflection after the manoeuvre: 0 m"
    assert headline(metrics, {}, 1.0) == "tip deflection after the manoeuvre: 0 m"
    assert headline({**metrics, "goal_error": None}, {}, 0.1).startswith("tip deflection")


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
    terminal.say(words, head="error: ")
    assert capsys.readouterr().err == f"error: {words}\n"
