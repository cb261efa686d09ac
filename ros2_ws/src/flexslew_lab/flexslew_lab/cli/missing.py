"""What to do where a package is not installed: ROS 2, or an extra of the installation by pip."""

from importlib.util import find_spec

from flexslew_plant.errors import BadInput
from flexslew_plant.extras import EXTRAS, install_command
from flexslew_plant.network import report_network

ROS = frozenset(
    {
        *("rclpy", "flexslew_msgs", "builtin_interfaces", "geometry_msgs", "rcl_interfaces"),
        *("rosgraph_msgs", "sensor_msgs", "std_msgs", "std_srvs", "tf2_msgs", "visualization_msgs"),
    }
)
WITHOUT_ROS = (
    "ROS 2 is not installed here: fly with --in-process, or use ./flexslew of a checkout, which "
    "sets ROS 2 up"
)


def remedy(error: ModuleNotFoundError) -> str:
    """Return one line with the remedy for a missing package; empty if there is none."""
    package = (error.name or "").partition(".")[0]
    if package in ROS:
        return WITHOUT_ROS
    if package in EXTRAS:
        return (
            f"this needs the package {package}, which is not installed: {install_command(package)}"
        )
    return ""


def require_ros() -> None:
    """Refuse if ROS 2 or the messages of the bench are missing; print how far the bench is open.

    Raises:
        BadInput: if one of them is missing, or FLEXSLEW_NETWORK has a wrong value.
    """
    if any(find_spec(package) is None for package in ("rclpy", "flexslew_msgs")):
        raise BadInput(WITHOUT_ROS)
    report_network()
