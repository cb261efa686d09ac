"""What setup.py installs: an executable for every law of the table."""

import runpy
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from flexslew_control.controllers import CONTROLLERS

SETUP = Path(__file__).parents[2] / "ros2_ws" / "src" / "flexslew_control" / "setup.py"


def test_every_law_has_an_executable_of_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    told: dict[str, Any] = {}
    monkeypatch.setattr(import_module("setuptools"), "setup", lambda **values: told.update(values))
    monkeypatch.chdir(SETUP.parent)
    runpy.run_path(str(SETUP))
    scripts = told["entry_points"]["console_scripts"]
    names = [script.partition(" = ")[0] for script in scripts]
    assert sorted(names) == sorted(["planner", "controller", *CONTROLLERS])
