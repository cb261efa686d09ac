"""What the command line says where ROS 2 or an extra is not installed."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from flexslew_lab.cli.missing import EXTRAS, remedy

ROOT = Path(__file__).parents[3]


def without(package: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    program = (
        f"import sys; sys.modules[{package!r}] = None; sys.argv = ['flexslew', *{arguments!r}]\n"
        "from flexslew_lab.cli.main import main\nmain()"
    )
    environment = {**os.environ, "COLUMNS": "80"}
    return subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, env=environment
    )


@pytest.mark.parametrize(
    "arguments",
    [["trial"], ["controllers"], ["switch", "pd_feedforward"], ["live"], ["play", str(ROOT)]],
)
def test_without_ros_one_line_says_what_to_do(arguments: list[str]) -> None:
    done = without("rclpy", *arguments)
    assert done.returncode == 2
    assert done.stderr.splitlines() == [
        "error: ROS 2 is not installed here: fly with --in-process, or use ./flexslew of a "
        "checkout, which sets ROS 2 up"
    ]


def test_an_extra_that_is_missing_is_named_as_pip_takes_it() -> None:
    done = without("pyarrow", "log", "export", str(ROOT))
    assert done.returncode == 2
    assert done.stderr.splitlines() == [
        "error: the package pyarrow is missing; pip install 'flexslew[export]'"
    ]


def test_every_extra_named_is_one_of_the_project() -> None:
    extras = (ROOT / "pyproject.toml").read_text().partition("[project.optional-dependencies]")[2]
    for package, extra in EXTRAS.items():
        assert f"\n{extra} = [" in extras.partition("\n[")[0], package


def test_any_other_missing_module_is_a_fault_of_ours() -> None:
    assert remedy(ModuleNotFoundError("No module named 'numpi'", name="numpi")) == ""
