"""`./flexslew import`: a table, a file that a spacecraft uses, and a page that draws the modes."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.plant.testbeds.spacecraft.finite_elements.decks import computed
from tests.plant.testbeds.spacecraft.finite_elements.frames import ANGLE, arrays, saved

from flexslew_lab.cli.main import main
from flexslew_plant.testbeds.spacecraft.finite_elements.imported import (
    ImportOptions,
    import_model,
)
from flexslew_plant.testbeds.spacecraft.shapes.modal_file import modal_shape

DOCS = Path(__file__).parents[3] / "docs"


def run(monkeypatch: pytest.MonkeyPatch, *words: Any) -> int:
    monkeypatch.setattr("sys.argv", ["flexslew", "import", *map(str, words)])
    with pytest.raises(SystemExit) as leave:
        main()
    return int(leave.value.code or 0)


@pytest.mark.parametrize("ending", ["yaml", "npz"])
def test_the_file_that_is_written_is_the_reduced_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], ending: str
) -> None:
    model, to = saved(tmp_path, **arrays(ANGLE)), tmp_path / "out" / f"panel.{ending}"
    assert run(monkeypatch, model, "--modes", 5, "--damping", 0.01, "--to", to) == 0
    expected = import_model(model, ImportOptions(modes=5))
    shape = modal_shape(to)
    np.testing.assert_allclose(shape.frequencies, expected.reduction.frequencies, rtol=1e-9)
    np.testing.assert_allclose(shape.integrals.translation, expected.reduction.participation[:3])
    np.testing.assert_allclose(shape.integrals.rotation, expected.reduction.participation[3:])
    tip = np.array(ANGLE[-1]) - ANGLE[0]
    np.testing.assert_allclose(shape.tip.place, tip, atol=1e-8)
    moves = expected.reduction.shapes[-6:-3]  # of the last node
    np.testing.assert_allclose(shape.tip.displacement, moves, rtol=1e-7, atol=1e-8)
    assert shape.damping is not None
    out = capsys.readouterr().out
    assert re.search(r"left out +", out)
    page = to.with_suffix(".html").read_text()
    assert page.count("mode 5: ") == 1
    assert "Mode shapes" in page


def test_numbers_for_machines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    model = saved(tmp_path, **arrays(ANGLE))
    assert run(monkeypatch, model, "--boundary", "1", "--modes", 60, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["warnings"] == []
    assert found["origin"] == ANGLE[0]
    assert found["rigid"]["mass"] == pytest.approx(0.8 * (1.3 + np.hypot(1.0, 0.4)))
    assert 0.0 <= found["left_out"]["about z"] < 0.05  # of this many modes
    assert sum(found["effective_mass"]["z"]) == pytest.approx(1.0 - found["left_out"]["z"])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--to", "panel.csv"], "--to: 'panel.csv' is not allowed: ends in .yaml"),
        (["--damping", "1.5"], "--damping: 1.5 is not allowed: 0 to 1"),
        (["--origin", "1,2"], "--origin: '1,2' is not allowed: three numbers"),
        (["--units", "mm"], "units: 'mm' is not allowed"),
        (["--boundary", "root"], "boundary: 'root' is not allowed"),
        (["--modes", "0"], "modes: 0 is not allowed"),
    ],
)
def test_a_wrong_option_is_refused_in_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    options: list[str],
    words: str,
) -> None:
    assert run(monkeypatch, saved(tmp_path, **arrays(ANGLE)), *options) == 2
    error = " ".join(capsys.readouterr().err.split())
    assert words in error
    assert [path.name for path in tmp_path.iterdir()] == ["model.npz"]


def test_the_tutorial_prints_what_its_page_shows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "100")  # the table is wider than a narrow terminal
    page = (DOCS / "finite_elements.md").read_text()
    path = computed(tmp_path, (DOCS / "examples" / "panel.inp").read_text())
    command = next(line for line in page.splitlines() if "import panel.inp" in line)
    words = [path if word == "panel.inp" else word for word in command.split()[2:]]
    words[-1] = tmp_path / "panel.yaml"
    assert run(monkeypatch, *words) == 0
    out, err = capsys.readouterr()
    assert "warning" not in err
    printed = [" ".join(line.split()) for line in out.splitlines()]
    rows = re.findall(r"^     (mode .*|\d .*|all .*|left out .*)$", page, re.MULTILINE)
    assert len(rows) == 9
    for row in rows:
        assert " ".join(row.split()) in printed
    assert modal_shape(tmp_path / "panel.yaml").modes == 6
