"""Every ROS process of the tests stays on 127.0.0.1, in a domain of its own."""

import os
from pathlib import Path

import pytest

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
