"""Of two controllers with one name the younger is silent while the older lives."""

from rclpy.node import Node

from flexslew_plant.graph import topics
from flexslew_plant.ros.alive import Alive
from flexslew_plant.ros.graph import PlantWatch
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.offers import subscription

INACTIVE = "this one is silent while that one lives"


def wait_until_unique(loop: Loop, node: Node, exit_with_plant: bool) -> Alive:
    """Return a life of its own as soon as no other one of this name lives, or the plant has left.

    Args:
        loop: that serves the node.
        node: of the controller, which has published nothing yet.
        exit_with_plant: end the process when the plant is gone.
    """
    alive = loop.live(node, "controller")
    listener = subscription(node, topics.TESTBED, lambda _: None)
    watch = PlantWatch(loop, node, listener, alive.heartbeats, exit_with_plant)
    logged = False

    def check() -> None:
        nonlocal logged
        watch.look()
        if not logged and (previous := alive.previous):
            logged = True
            node.get_logger().error(f"{previous}; {INACTIVE}")

    loop.begin(alive, check)
    node.destroy_subscription(listener)
    return alive
