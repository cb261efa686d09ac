import sys
from pathlib import Path

import pytest

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
    with pytest.raises(
        BadInput, match=r"'flexslew\[EXTRA\]'.* extras: c, casadi, console, ctrlsys,"
    ):
        checkout.extras()
