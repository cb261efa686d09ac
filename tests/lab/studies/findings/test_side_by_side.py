"""Two studies on one page, also two of one name."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from flexslew_lab.cli.main import app
from flexslew_lab.run.pool import InThisProcess
from flexslew_lab.studies.finish import finished
from flexslew_lab.studies.run import prepare, run_study
from flexslew_lab.studies.study import Study

CRITERIA = {"peak_tip_deflection": {"below": 1.0, "probability": 0.5}}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("folders", "called"),
    [(("before", "after"), ("small (before)", "small (after)")), (("a/s", "b/s"), None)],
)
def test_studies_of_one_name_are_told_apart(
    folders: tuple[str, str], called: tuple[str, str] | None, study_of: Callable[..., Study],
    tmp_path: Path,
) -> None:  # fmt: skip
    first, second = (tmp_path / folder for folder in folders)
    one = prepare(study_of(criteria=CRITERIA))
    finished(one.study, run_study(one, first, InThisProcess(one.job)))
    shutil.copytree(first, second)
    page = tmp_path / "two.html"
    words = ["study", "report", str(first), str(second), "--out", str(page)]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    assert "peak_tip_deflection" in result.output
    assert "largest_effort_step" not in result.output  # which no trial has
    text = re.sub("<wbr>", "", page.read_text(encoding="utf-8")).replace("\\u002f", "/")
    for name in called or (f"small ({first})", f"small ({second})"):
        assert f"mean, {name}" in text  # heads of the table
        assert f'"name":"{name}"' in text  # curves
        assert text.count(f'<td class="method">{name}</td>') == 1  # criteria
