"""Parts of what a metric is given."""

from flexslew_lab.metrics.metric import Block


def ticks_of(block: Block, first: int, last: int) -> Block:
    """Return the ticks from the first up to before the last."""
    return Block._make(None if column is None else column[first:last] for column in block)
