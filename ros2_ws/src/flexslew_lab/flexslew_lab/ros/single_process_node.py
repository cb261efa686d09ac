"""Plant and one controller in one process: still two nodes and DDS between them, one executor."""

from functools import partial

from flexslew_control.ros.controller_node import ControllerNode
from flexslew_plant.ros.node import Loop, run_node
from flexslew_plant.ros.plant_node import Plant


class Sweep:
    """Both nodes behind one loop.

    Args:
        controller: name of the controller's node.
        loop: that serves both.
    """

    def __init__(self, controller: str, loop: Loop) -> None:
        self._nodes = ControllerNode(controller, loop), Plant(loop)

    def poll(self) -> float:
        """Do what is due in both; return the wall seconds until something can be due again."""
        return min(node.poll() for node in self._nodes)

    def close(self) -> None:
        """Leave the graph."""
        for node in self._nodes:
            node.close()


def main() -> None:
    """Run the plant beside PD + feedforward until it is done or interrupted."""
    run_node(partial(Sweep, "pd_feedforward"))


if __name__ == "__main__":
    main()
