"""`colcon test` runs pytest in the folder of a package, which finds the package's tests there."""

import subprocess
import sys
from configparser import ConfigParser
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("package", ["flexslew_plant", "flexslew_control", "flexslew_lab"])
def test_each_package_names_its_tests_and_the_tool_that_runs_them(package: str) -> None:
    folder = ROOT / "ros2_ws" / "src" / package
    found = ConfigParser()
    found.read(folder / "setup.cfg")
    places = found["tool:pytest"]["testpaths"].split()
    assert all(list((folder / place).glob("**/test_*.py")) for place in places)
    # without it colcon runs unittest, which finds nothing
    assert 'extras_require={"test": ["pytest"]}' in (folder / "setup.py").read_text()


@pytest.mark.slow
def test_the_tests_of_a_package_run_in_its_folder() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-k", "refusal", "--ignore-glob=*/testbeds/*"],
        cwd=ROOT / "ros2_ws" / "src" / "flexslew_plant", capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    assert " passed" in done.stdout
