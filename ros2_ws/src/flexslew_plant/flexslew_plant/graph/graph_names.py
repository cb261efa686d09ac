"""Names on the graph of ROS, checked before rclpy raises."""

import re

from flexslew_plant.errors import BadInput

_NAME = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")


def require_name(name: str, key: str) -> None:
    """Check the name of a topic or a namespace.

    Args:
        name: with or without the slash in front.
        key: to name in an error.

    Raises:
        BadInput: it is none.
    """
    if not _NAME.fullmatch(name):
        words = "letters, digits and _, no part begins with a digit; parts are separated by /"
        raise BadInput(words, key=key, value=name)
