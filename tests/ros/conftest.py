"""Every ROS process of the tests stays on 127.0.0.1, in a domain of its own."""

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from flexslew_lab.cli.main import main
from flexslew_plant.direct.names import SETTING as TRANSPORT
from flexslew_plant.network import SETTING, prepare


@pytest.fixture(autouse=True, scope="session")
def _strict_loopback(request: pytest.FixtureRequest) -> None:
    os.environ.pop(SETTING, None)
    os.environ[TRANSPORT] = request.config.option.transport
    prepare(os.environ)
    os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
    # nodes of the tests are modules of this checkout, which python -P looks for nowhere else
    root = str(Path(__file__).parents[2])
    os.environ["PYTHONPATH"] = os.pathsep.join((root, os.environ.get("PYTHONPATH", "")))
    os.environ.pop("ROS_DOMAIN_ID", None)


@pytest.fixture
def call(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., tuple[Any, str]]:
    """Return what runs the command line and returns its exit code and what it says."""

    def run(*words: str) -> tuple[Any, str]:
        monkeypatch.setattr(sys, "argv", ["flexslew", *words])
        with pytest.raises(SystemExit) as end:
            main()
        said = capsys.readouterr()
        return end.value.code, (said.out + said.err).strip()

    return run
