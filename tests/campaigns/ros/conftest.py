"""As over ROS everywhere: on 127.0.0.1 alone."""

from tests.ros.conftest import _strict_loopback  # noqa: F401
