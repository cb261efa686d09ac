from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from flexslew_lab.studies.run import PreparedStudy, prepare
from flexslew_lab.studies.study import Study, parse_study
from flexslew_plant.own_code import ANY_CODE
from flexslew_plant.yaml_data import yaml_text

TRIAL: dict[str, Any] = {
    "name": "small",
    "duration": 1.0,
    "testbed": {"modes": 1},
    "plan": {"method": "none", "goal": {"base_yaw": 0.1, "hub_pitch": 0.05}, "duration": 0.5},
    "controllers": {"pd_feedforward": {"kp": [460.0, 460.0], "kd": [920.0, 920.0]}},
}
STUDY: dict[str, Any] = {
    "study": "small",
    "trial": "small.yaml",
    "seed": 3,
    "sampling": {"method": "random", "n": 12},
    "vary": {
        "testbed.parameters.bending_stiffness": {"relative": {"uniform": [-0.2, 0.2]}},
        "sensors.joint_velocity.noise": {"loguniform": [1e-5, 1e-3]},
    },
    "keep": {"bags": "none"},
    "batch": False,
}


@pytest.fixture(scope="session")
def study_in() -> Callable[..., Study]:
    """Return a function that gives the study of a file in a folder with some keys changed."""

    def make(folder: Path, flown: dict[str, Any] | None = None, **keys: Any) -> Study:
        (folder / "small.yaml").write_text(yaml_text(TRIAL | (flown or {})))
        text = yaml_text({k: v for k, v in (STUDY | keys).items() if v is not None})
        (folder / "study.yaml").write_text(text)
        return parse_study(text, str(folder / "study.yaml"), folder, ANY_CODE)

    return make


@pytest.fixture
def study_of(study_in: Callable[..., Study], tmp_path: Path) -> Callable[..., Study]:
    """Return a function that gives the study of a file with some keys changed."""
    return partial(study_in, tmp_path)


@pytest.fixture
def ready(study_of: Callable[..., Study]) -> PreparedStudy:
    return prepare(study_of())
