"""Every ROS process of the tests stays on 127.0.0.1, in a domain of its own."""

import os
from pathlib import Path

import pytest

_PROFILE = Path(__file__).parents[2] / "setup" / "fastdds-loopback.xml"


@pytest.fixture(autouse=True, scope="session")
def _strict_loopback() -> None:
    assert _PROFILE.is_file(), "without the profile DDS would use every network"
    kilted = os.environ.get("ROS_DISTRO", "kilted") == "kilted"
    variable = f"{'FASTDDS' if kilted else 'FASTRTPS'}_DEFAULT_PROFILES_FILE"
    os.environ[variable] = str(_PROFILE)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SYSTEM_DEFAULT"
    os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
    os.environ.pop("ROS_DOMAIN_ID", None)
