from functools import lru_cache

import numpy as np
import pytest
from tests.panel_numbers import numbers

from flexslew_lab.reproduce.time_optimal import simulate, time_optimal_figures, time_optimal_rows

rows = lru_cache(time_optimal_rows)
figures = lru_cache(time_optimal_figures)


def curves(name: str) -> list[np.ndarray]:
    """Return the curves of a figure, panel by panel."""
    return [numbers(trace["y"]) for panel in figures()[name].panels for trace in panel.traces]


@pytest.mark.slow
def test_every_number_is_reproduced() -> None:
    assert [row for row in rows() if not row["ok"]] == []


@pytest.mark.slow
def test_every_slew_is_checked_by_the_gradient_method_too() -> None:
    assert len([row for row in rows() if "switching-time optimisation" in row["item"]]) == 6


def test_every_figure_that_is_no_sketch_is_drawn() -> None:
    drawn = figures()
    papers = {int(name.removeprefix("figure_").rstrip("ab")) for name in drawn}
    assert papers == {2, 3, 4, 5, 8, 9, 10, 11, 12, 13, 14}
    assert all(np.isfinite(y).all() for name in drawn for y in curves(name))


def test_efforts_of_the_figures_switch_where_they_should() -> None:
    for name, switches in (("figure_4", 3), ("figure_5", 5), ("figure_12", 3), ("figure_13", 5)):
        (effort,) = curves(name)
        assert np.count_nonzero(np.diff(np.sign(effort[:-1]))) == switches


def test_the_robust_slew_leaves_less_in_figure_14() -> None:
    hub_plain, hub_robust, tip_plain, tip_robust = curves("figure_14")
    middle = slice(11, 25)  # 0.92 to 1.18 of the stiffness
    at_nominal = 15
    keep = np.arange(31)[middle] != at_nominal
    assert np.all(tip_robust[middle][keep] < tip_plain[middle][keep])
    assert np.all(hub_robust[middle][keep] < hub_plain[middle][keep])
    assert max(tip_plain[at_nominal], tip_robust[at_nominal]) < 1e-8


@pytest.mark.parametrize(("name", "factor", "left"), [("oscillator, robust", 0.9, 0.0119410)])
def test_the_figures_show_the_published_residual(name: str, factor: float, left: float) -> None:
    ticks = np.linspace(0.0, 12.0, 6001)
    after = simulate(name, factor, ticks)[ticks > 5.87]
    assert np.abs(after[:, 1]).max() == pytest.approx(left, rel=1e-4)
