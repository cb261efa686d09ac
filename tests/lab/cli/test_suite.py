from pathlib import Path

import pytest
import typer
from typer.core import TyperCommand

from flexslew_lab.cli import checkout
from flexslew_lab.cli.suite import (
    GROUPS,
    NO_TESTS_EXIT_CODE,
    OVER_ROS,
    Selection,
    exit_code,
    parts,
    read_selection,
)

PASSES, FAILS = "def test_passes(): pass", "def test_fails(): assert False"
FLAKY = """
from pathlib import Path


def test_second_time():
    seen = Path(__file__).with_suffix(".seen")
    second = seen.exists()
    seen.touch()
    assert second
"""
DIES = "import os\n\ndef test_dies(): os.kill(os.getpid(), 9)"
MARKED = """
import pytest


def test_default(): pass

@pytest.mark.ros
@pytest.mark.parametrize("number", range(3))
def test_over_ros(number): assert False

@pytest.mark.alone
def test_alone(): pass
"""


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the root of a checkout with a test in each part."""
    for part in ("tests/plant", *OVER_ROS, *GROUPS):
        (tmp_path / part).mkdir(parents=True, exist_ok=True)
    (tmp_path / GROUPS[-1] / "test_loops.py").write_text(PASSES)
    (tmp_path / "tests" / "plant" / "test_plain.py").write_text(PASSES)
    (tmp_path / "tests" / "ros" / "test_marked.py").write_text(MARKED)
    (tmp_path / "tests" / "campaigns" / "ros" / "test_campaign.py").write_text(PASSES)
    markers = ["ros", "browser", "campaign", "matrix", "slow", "alone"]
    registered = "markers =\n" + "\n".join(f"  {name}: of a test" for name in markers)
    (tmp_path / "pytest.ini").write_text(f"[pytest]\ntestpaths = tests\n{registered}\n")
    monkeypatch.delenv("PYTEST_ADDOPTS", raising=False)
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")  # most of the time is plugins'
    monkeypatch.setenv("PYTEST_PLUGINS", "xdist.plugin")
    monkeypatch.setattr(checkout, "_root", lambda: tmp_path)
    monkeypatch.setattr(checkout, "_wait_for_machine_code", lambda: None)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def selected(*arguments: str) -> Selection:
    selection = read_selection(arguments)
    assert isinstance(selection, Selection)
    return selection


def ended(*arguments: str, everything: bool = False) -> int:
    """Return the exit code of the command."""
    context = typer.Context(TyperCommand("test"))
    context.args = [*arguments]
    with pytest.raises(typer.Exit) as end:
        checkout.run_tests(context, everything)
    return end.value.exit_code


@pytest.mark.usefixtures("tree")
def test_the_whole_suite_runs_in_groups_each_test_in_one() -> None:
    default = "not (ros or browser or campaign or matrix or slow)"
    whole, shared, alone = parts(Selection(), all_tests=False)
    assert whole[4:6] == ("-m", default)
    assert {part for part in whole if part.startswith("--ignore")} == {
        f"--ignore={folder}" for folder in OVER_ROS
    }
    assert whole[-1] == "tests"
    assert shared[4:] == ("-m", f"{default} and not alone", *OVER_ROS)
    assert alone == ("-m", f"{default} and alone", *OVER_ROS)
    *plain, shared, alone = parts(Selection(), all_tests=True)
    assert [part[-1] for part in plain] == ["tests", *GROUPS]
    assert all("-m" not in part for part in plain)
    assert (shared[4:6], alone[:2]) == (("-m", "not alone"), ("-m", "alone"))
    for folder in (*OVER_ROS, *GROUPS):
        outer = [part for part in plain if f"{folder}/".startswith(f"{part[-1]}/")]
        kept = [part for part in outer if f"--ignore={folder}" not in part]
        assert [part[-1] for part in kept] == [folder] * (folder in GROUPS)


@pytest.mark.usefixtures("tree")
@pytest.mark.parametrize(
    ("arguments", "paths"),
    [
        (("-k", "energy", "--durations=3"), [["tests"], OVER_ROS, OVER_ROS]),
        (("tests/plant", "-x"), [["tests/plant"]]),
        (("-k", "tests", "tests"), [["tests"], OVER_ROS, OVER_ROS]),
        (("tests/campaigns",), [["tests/campaigns"], OVER_ROS[1:], OVER_ROS[1:]]),
        (("tests/plant", "tests/ros"), [["tests/plant"], OVER_ROS[:1], OVER_ROS[:1]]),
        (("tests/ros/test_marked.py::test_alone",), [["tests/ros/test_marked.py::test_alone"]] * 2),
    ],
)
def test_paths_choose_the_parts_and_options_reach_each(
    arguments: tuple[str, ...], paths: list[list[str]]
) -> None:
    chosen = [*parts(selected(*arguments), all_tests=False)]
    given = [[a for a in part[-2:] if a.startswith("tests/") or a == "tests"] for part in chosen]
    assert [g[-len(p) :] if p else g for g, p in zip(given, paths, strict=True)] == [
        list(p) for p in paths
    ]
    options = [a for a in arguments if a.startswith("-")]
    assert all(option in part for option in options for part in chosen)


@pytest.mark.usefixtures("tree")
def test_an_expression_of_the_user_a_file_or_cases_replace_the_selection() -> None:
    assert selected("-m", "slow or ros").expression(all_tests=False) == "(slow or ros)"
    assert selected("tests/ros/test_marked.py").expression(all_tests=False) == ""
    assert selected("tests/ros").expression(all_tests=False) != ""
    assert Selection(cases=True).expression(all_tests=False) == ""


@pytest.mark.slow
@pytest.mark.usefixtures("tree")
def test_what_pytest_answers_without_a_test_runs_none(capfd: pytest.CaptureFixture[str]) -> None:
    assert read_selection(["--markers"]) == 0
    assert "@pytest.mark.alone" in capfd.readouterr().out
    assert read_selection(["--no-such-option"]) == 4
    assert "--no-such-option" in capfd.readouterr().err


def test_an_empty_part_fails_only_if_all_are() -> None:
    assert exit_code([0, NO_TESTS_EXIT_CODE, 0]) == 0
    assert exit_code([NO_TESTS_EXIT_CODE, NO_TESTS_EXIT_CODE]) == NO_TESTS_EXIT_CODE
    assert exit_code([1, NO_TESTS_EXIT_CODE, 137]) == 137


@pytest.mark.slow
def test_the_parts_run_what_the_markers_select(tree: Path) -> None:
    assert ended("-n", "0") == 0
    assert ended("-n", "0", "-k", "nothing_has_this_name") == NO_TESTS_EXIT_CODE
    assert ended("-n", "0", "tests/ros", everything=True) == 1
    assert ended("-n", "0", "tests/lab/studies/test_loops.py::test_passes", everything=True) == 0


@pytest.mark.parametrize(
    ("text", "code"), [(FLAKY, 1), (FAILS, 1), (DIES, 137), ("import nowhere", 2)]
)
def test_what_fails_has_failed_and_runs_once(tree: Path, text: str, code: int) -> None:
    (tree / "tests" / "plant" / "test_plain.py").write_text(text)
    assert ended("-n", "0", "tests/plant") == code


def test_no_further_part_starts_where_a_failure_stops(
    tree: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ran = []

    def run(*arguments: str) -> int:
        ran.append(arguments)
        return 1

    monkeypatch.setattr(checkout, "_pytest", run)
    assert ended("-x") == 1
    assert len(ran) == 1
    assert ended("--durations=1") == 1
    assert len(ran) == 1 + len([*parts(Selection(), all_tests=False)])
