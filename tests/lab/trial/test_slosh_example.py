"""The trial of docs/spacecraft/slosh.md, as it stands there."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import trial_of_values

DOCS = Path(__file__).parents[3] / "docs"


def flown(folder: Path, kind: str) -> Any:
    """Return the metrics of the trial with this hinge."""
    page = (DOCS / "spacecraft/slosh.md").read_text()
    values = yaml.safe_load(page.split("```yaml\n")[1].split("```")[0])
    hinge = values["testbed"]["appendages"]["tank"]["hinge"]
    hinge["kind"] = kind
    if kind == "fixed":
        del hinge["damper"]
    found = run_trial(trial_of_values(values, "docs"), "docs", folder, in_process=True)
    assert found.exit_code == 0, found.message
    return found.metrics


@pytest.mark.slow
def test_a_craft_turns_while_its_liquid_swings_and_its_law_brings_both_to_rest(
    tmp_path: Path,
) -> None:
    swings, stands = (flown(tmp_path / kind, kind) for kind in ("passive", "fixed"))
    assert swings["final_error"].keys() == {"roll", "pitch", "yaw", "thrust"}  # the hinge is none
    assert abs(swings["final_error"]["yaw"]) < 1e-3
    residuals = [each["residual_attitude_error"]["yaw"] for each in (swings, stands)]
    assert residuals[0] > 3.0 * residuals[1]
    assert stands["final_error"]["yaw"] == pytest.approx(0.0, abs=1e-9)
