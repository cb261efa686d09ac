"""What the command line says where ROS 2 or an extra is not installed."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from tests.representatives import representatives

from flexslew_lab.cli.missing import remedy
from flexslew_lab.run.domain import locked_domain
from flexslew_plant import extras
from flexslew_plant.extras import EXTRAS, LOCK, WITH_PIP, install_command

ROOT = Path(__file__).parents[3]


def without(packages: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    program = (
        f"import sys; sys.modules |= dict.fromkeys({packages.split()!r})\n"
        f"sys.argv = ['flexslew', *{arguments!r}]\n"
        "from flexslew_lab.cli.main import main\nmain()"
    )
    environment = {**os.environ, "COLUMNS": "80"}
    return subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, env=environment
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "arguments",
    representatives(
        [["trial"], ["controllers"], ["switch", "pd_feedforward"], ["live"], ["play", str(ROOT)]],
        ["trial"],
        ["switch", "pd_feedforward"],
    ),
)
def test_without_ros_one_line_says_what_to_do(
    arguments: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    with (
        locked_domain(),
        locked_domain(),
    ):  # nor is anybody asked before which of two benches is meant
        done = without("rclpy", *arguments)
    assert done.returncode == 2
    assert done.stderr.splitlines() == [
        "error: ROS 2 is not installed here: fly with --in-process, or use ./flexslew of a "
        "checkout, which sets ROS 2 up"
    ]


@pytest.mark.slow
def test_a_trial_and_its_nodes_need_no_extra(tmp_path: Path) -> None:
    out = tmp_path / "run"
    program = f"""
import sys
for package in {sorted(EXTRAS)!r}:
    sys.modules[package] = None
import flexslew_lab.compile_kernels
from flexslew_control.ros import controller_node, planner_node
from flexslew_lab.cli.main import main
from flexslew_lab.ros import play_node, recorder_node
from flexslew_plant.ros import plant_node
sys.argv = ["", "trial", "m1", "--in-process", "--set", "duration=0.1", "--out", {str(out)!r}]
main()
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (out / "report.html").is_file()


def test_an_extra_that_is_missing_is_named_with_the_command_that_installs_it() -> None:
    done = without("pyarrow", "log", "export", str(ROOT))
    assert done.returncode == 2
    assert done.stderr.splitlines() == [
        "error: this needs the package pyarrow, which is not installed: ./flexslew extras export"
    ]


def test_gains_names_the_package_whose_extra_brings_all_that_it_needs() -> None:
    done = without("optuna pyarrow", "gains", "m1")
    assert done.returncode == 2
    assert "needs the package optuna" in done.stderr


def test_outside_of_a_checkout_it_is_the_command_of_pip(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(extras, "LOCK", "nowhere")
    assert install_command("pyarrow") == "pip install 'flexslew[export]'"
    assert install_command("control") == "pip install control"


def test_every_extra_is_in_the_lock_or_comes_by_pip_alone() -> None:
    by_pip = {package for package in EXTRAS if "./flexslew" not in install_command(package)}
    assert by_pip == {"pandas", "xarray"}
    for package in {*EXTRAS} - by_pip:
        extra = install_command(package).removeprefix("./flexslew extras ")
        lock = (ROOT / "setup" / LOCK.format(extra)).read_text()
        names = {"foxglove": "foxglove-sdk", "serial": "pyserial"}  # other than what is imported
        assert f"\n{names.get(package, package)}==" in lock, package


def test_every_extra_named_is_one_of_the_project() -> None:
    extras = (ROOT / "pyproject.toml").read_text().partition("[project.optional-dependencies]")[2]
    for package, extra in EXTRAS.items():
        if extra == WITH_PIP:
            continue
        assert f"\n{extra} = [" in extras.partition("\n[")[0], package


def test_any_other_missing_module_is_a_fault_of_ours() -> None:
    assert remedy(ModuleNotFoundError("No module named 'numpi'", name="numpi")) == ""
