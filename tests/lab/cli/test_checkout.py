import sys
from pathlib import Path

import pytest
import typer
from typer.core import TyperCommand

from flexslew_lab.cli import checkout
from flexslew_plant.errors import BadInput

BENCHMARK = """
from multiprocessing import get_context


def half(number):
    return number / 2.0


def figures():
    with get_context("forkserver").Pool(1) as pool:
        return {"half": pool.apply_async(half, (3.0,)).get(60.0)}
"""


FLAKY = """
from pathlib import Path


def test_second_time():
    seen = Path(__file__).with_suffix(".seen")
    second = seen.exists()
    seen.touch()
    assert second
"""
PASSES, FAILS = "def test_passes(): pass", "def test_fails(): assert False"


DIES = "import os\n\ndef test_dies(): os.kill(os.getpid(), 9)"


@pytest.mark.parametrize(
    ("plain", "over_ros", "alone", "code", "workers"),
    [
        (PASSES, PASSES, PASSES, 0, True),
        (PASSES, FLAKY, PASSES, 1, False),
        (PASSES, FAILS, PASSES, 1, False),
        (PASSES, FLAKY, DIES, 137, False),
        (FLAKY, PASSES, PASSES, 1, True),
        (PASSES, PASSES, FLAKY, 1, False),
        (PASSES, "import nowhere", PASSES, 2, False),
    ],
)
def test_what_fails_has_failed_and_runs_once(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    plain: str,
    over_ros: str,
    alone: str,
    code: int,
    workers: bool,
) -> None:
    (tmp_path / "tests" / "ros").mkdir(parents=True)
    campaigns = tmp_path / "tests" / "campaigns" / "ros"
    campaigns.mkdir(parents=True)
    (campaigns / "test_campaign.py").write_text(PASSES)
    (tmp_path / "tests" / "test_plain.py").write_text(plain)
    (tmp_path / "tests" / "ros" / "test_over_ros.py").write_text(over_ros)
    marked = f"import pytest\npytestmark = pytest.mark.alone\n{alone}"
    (tmp_path / "tests" / "ros" / "test_alone.py").write_text(marked)
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = alone: none beside it\n")
    calls = []

    def counted(*arguments: str) -> int:
        calls.append(arguments)
        return real(*arguments, *(() if workers else ("-n", "0")))

    real = checkout._pytest
    monkeypatch.setattr(checkout, "_root", lambda: tmp_path)
    monkeypatch.setattr(checkout, "_pytest", counted)
    monkeypatch.delenv("PYTEST_ADDOPTS", raising=False)
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")  # most of the time is plugins'
    monkeypatch.setenv("PYTEST_PLUGINS", "xdist.plugin")
    with pytest.raises(typer.Exit) as ended:
        checkout.test(typer.Context(TyperCommand("test")))
    assert (ended.value.exit_code, len(calls)) == (code, 3)


def test_a_benchmark_may_start_processes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "benchmarks").mkdir()
    (tmp_path / "benchmarks" / "halving.py").write_text(BENCHMARK)
    monkeypatch.setattr(checkout, "_root", lambda: tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    checkout.bench(["halving"], as_json=True)
    assert '"half": 1.5' in capsys.readouterr().out


def test_outside_of_a_checkout_extras_come_by_pip(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(checkout, "__file__", str(tmp_path / "checkout.py"))
    with pytest.raises(BadInput, match=r"'flexslew\[EXTRA\]'.* extras: casadi, console, ctrlsys,"):
        checkout.extras()
