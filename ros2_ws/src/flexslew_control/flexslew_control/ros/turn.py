"""Of two controllers with one name the younger is silent while the older lives."""

from rclpy.node import Node

from flexslew_plant.graph import topics
from flexslew_plant.ros.alive import Alive
from flexslew_plant.ros.graph import PlantWatch
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.offers import subscription

SILENT = "this one is silent while that one lives"


def await_turn(loop: Loop, node: Node, exit_with_plant: bool) -> Alive:
    """Return a life of its own as soon as no other one of this name lives, or the plant has left.

    Args:
        loop: that serves the node.
        node: of the controller, which has published nothing yet.
        exit_with_plant: end the process when the plant is gone.
    """
    alive = loop.live(node, "controller")
    heard = subscription(node, topics.TESTBED, lambda _: None)
    watch = PlantWatch(loop, node, heard, alive.presence, exit_with_plant)
    told = False

    def look() -> None:
        nonlocal told
        watch.look()
        if not told and (older := alive.older):
            told = True
            node.get_logger().error(f"{older}; {SILENT}")

    loop.begin(alive, look)
    node.destroy_subscription(heard)
    return alive
