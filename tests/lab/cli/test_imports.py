"""What the command line loads before it knows what is requested of it."""

import subprocess
import sys

import pytest
from tests.representatives import representatives

from flexslew_lab.cli import early, operate

HEAVY = ("numpy", "scipy", "numba", "plotly", "pyarrow", "casadi", "rclpy", "rosbags", "nicegui")
DESIGN = ("control", "ctrlsys", "matplotlib", "daqp", "optuna")  # what no flight needs


def printed(program: str) -> str:
    """Return the output of a program of its own."""
    words = [sys.executable, "-c", program]
    return subprocess.run(words, capture_output=True, text=True, check=True).stdout


@pytest.mark.parametrize(
    "arguments",
    representatives(
        [["--help"], ["trial", "--help"], ["log", "--help"], ["console", "--help"]],
        ["trial", "--help"],
    ),
)
def test_help_loads_no_numerics(arguments: list[str]) -> None:
    program = (
        f"import sys; sys.argv = ['flexslew', *{arguments}]\n"
        "from flexslew_lab.cli.main import main\n"
        "try: main()\n"
        f"finally: print('loaded:', sorted(set({HEAVY + DESIGN}) & set(sys.modules)))"
    )
    out = printed(program)
    assert "Usage" in out
    assert out.splitlines()[-1] == "loaded: []"


def test_import_flexslew_loads_no_numerics_and_a_flight_no_statistics() -> None:
    program = (
        "import sys, flexslew as fs\n"
        f"print('loaded:', sorted(set({HEAVY + DESIGN}) & set(sys.modules)))\n"
        "fs.fly(fs.trial('m1', {'duration': 0.1, 'plan': None}))\n"
        f"print('loaded:', sorted({{'scipy.stats', 'scipy.signal', 'plotly'}} & set(sys.modules)))"
    )
    out = printed(program)
    assert out == "loaded: []\nloaded: []\n"


def test_every_command_that_operates_a_bench_joins_its_graph_early() -> None:
    assert set(early.OPERATING) == {command.__name__ for command in operate.COMMANDS}


@pytest.mark.slow
def test_a_trial_is_read_without_what_takes_longer_to_load_than_all_else() -> None:
    program = (
        "import sys\n"
        "import flexslew_lab.trial.trial\n"
        "print('loaded:', sorted({'scipy.stats', 'scipy.signal'} & set(sys.modules)))"
    )
    out = printed(program)
    assert out == "loaded: []\n"


@pytest.mark.slow
def test_a_flight_and_its_nodes_load_nothing_of_the_design_side() -> None:
    program = (
        "import sys\n"
        "import flexslew_lab.run.run_trial, flexslew_lab.report.report\n"
        "from flexslew_control.controllers import CONTROLLERS, build_controller\n"
        "from flexslew_lab.notebook import fly, trial\n"
        "fly(trial('m1', {'duration': 0.1, 'plan': None}))\n"
        f"print('loaded:', sorted(set({DESIGN}) & set(sys.modules)))"
    )
    out = printed(program)
    assert out.splitlines()[-1] == "loaded: []"
