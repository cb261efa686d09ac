"""What a platform does in a block of ticks, worked out once for all metrics of the block."""

from flexslew_lab.metrics.metric import Block
from flexslew_plant.testbeds.contract import Motions
from flexslew_plant.testbeds.contract import Pointing as PointingTestbed


class _Last:
    """The block that was looked at last."""

    found: tuple[Block, PointingTestbed, dict[str, float], Motions] | None = None


def block_motions(testbed: PointingTestbed, block: Block, goal: dict[str, float]) -> Motions:
    """Return the motions of a block; see Pointing.motions.

    Args:
        testbed: testbed of the states.
        block: block of states.
        goal: goal of the joints by name.
    """
    last = _Last.found
    if last is not None and last[0] is block and last[1] is testbed and last[2] == goal:
        return last[3]
    motions = testbed.motions(block.position, block.velocity, goal)
    _Last.found = block, testbed, goal, motions
    return motions
