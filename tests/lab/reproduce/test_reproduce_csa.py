from functools import lru_cache
from pathlib import Path
from typing import Any

import pytest

from flexslew_lab.reproduce import REPRODUCTIONS, write_figures
from flexslew_lab.reproduce.csa import csa_figures, csa_rows
from flexslew_lab.reproduce.rows import KEYS
from flexslew_plant.errors import BadInput

rows = lru_cache(csa_rows)


def test_every_number_is_reproduced() -> None:
    assert [row for row in rows() if not row["ok"]] == []


def test_every_number_of_the_page_has_its_row() -> None:
    items = {row["item"] for row in rows()}
    assert len(items) == len(rows()) >= 60
    for word in ("J_a", "K_qq 3", "psi = 1.25", "Figure 4", "step: theta", "M8", "EI -20 %"):
        assert any(word in item for item in items), word


def test_rows_are_plain_data() -> None:
    for row in rows():
        assert list(row) == [*KEYS]
        kinds = [str, str, float, float, float, str, bool, str]
        assert [type(row[key]) for key in KEYS] == kinds
        assert row["tolerance_is"] in ("absolute", "at most")


@pytest.mark.slow
def test_the_figures_are_those_of_the_paper() -> None:
    figures = csa_figures()
    assert list(figures) == ["figure_3", "figure_4", "figure_5", "figure_7"]
    assert all(panel.traces for figure in figures.values() for panel in figure.panels)


@pytest.mark.parametrize("name", REPRODUCTIONS)
def test_every_reproduction_can_be_found(name: Any) -> None:
    assert callable(REPRODUCTIONS[name].rows)
    figures = REPRODUCTIONS[name].figures
    assert figures is None or callable(figures)


@pytest.mark.slow
def test_the_figures_are_written_as_one_page(tmp_path: Path) -> None:
    page = tmp_path / "new" / "csa.html"
    write_figures("csa", page)
    text = page.read_text()
    assert text.count('class="panel"') == 10
    assert "<h2>Figure 7</h2>" in text
    assert 'src="http' not in text


@pytest.mark.slow
def test_figures_of_a_paper_without_any_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="pi has no figures; allowed: csa"):
        write_figures("pi", tmp_path / "pi.html")
