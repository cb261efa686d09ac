"""A board keeps the rules of a serial line, and a wrong one is named."""

from pathlib import Path

from tests.plant.serial_line.lines import board
from tests.plant.serial_line.test_exchange import HELLO
from tests.present import present

from flexslew_lab.board_rules import STEPS, BoardRules
from flexslew_plant.serial_line.exchange import Exchange, Patience


def test_the_board_in_c_keeps_all_rules(tmp_path: Path) -> None:
    with board(tmp_path) as (port, _, _):
        rules = BoardRules(port, Exchange(port, Patience(20.0, 1.0)), HELLO)
        assert [result.wrong for result in rules.check()] == [""] * 5
    times = present(rules.times)
    assert times.steps.steps == STEPS
    assert 0.0 < times.steps.least <= times.steps.median <= times.steps.longest
    assert str(times).startswith("500 steps: shortest ")


def test_a_board_that_does_not_fit_breaks_the_first_rule(tmp_path: Path) -> None:
    with board(tmp_path) as (port, _, _):
        rules = BoardRules(port, Exchange(port), HELLO._replace(tips=()))
        (result,) = rules.check()
    assert (result.rule, "describes numbers 16" in result.wrong) == ("description", True)
