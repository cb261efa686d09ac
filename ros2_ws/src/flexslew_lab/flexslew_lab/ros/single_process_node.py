"""Plant and one controller in one process: two nodes, one executor, and calls between the two."""

from functools import partial

from flexslew_control.controllers import DEFAULT
from flexslew_control.ros.controller_node import ControllerNode
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.node_process import run_node
from flexslew_plant.ros.plant_node import Plant


class PlantAndController:
    """Both nodes behind one loop.

    Args:
        controller: name of the controller's node.
        loop: that serves both.
    """

    def __init__(self, controller: str, loop: Loop) -> None:
        controller_node = ControllerNode(controller, loop, by_call=True)
        self._plant = Plant(loop, controller_node.answering)
        self._nodes = controller_node, self._plant

    def poll(self) -> float:
        """Do what is due in both; return the wall seconds until something can be due again."""
        return min(node.poll() for node in self._nodes)

    def interrupted(self) -> None:
        """Let the plant report that the run ends before its time."""
        self._plant.interrupted()


def main() -> None:
    """Run the plant together with PD + feedforward until it is done or interrupted."""
    run_node(partial(PlantAndController, DEFAULT))


if __name__ == "__main__":
    main()
