"""Every ROS process of the tests stays on 127.0.0.1, in a domain of its own."""

import os

import pytest

from flexslew_plant.network import SETTING, prepare


@pytest.fixture(autouse=True, scope="session")
def _strict_loopback() -> None:
    os.environ.pop(SETTING, None)
    prepare(os.environ)
    os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
    os.environ.pop("ROS_DOMAIN_ID", None)
