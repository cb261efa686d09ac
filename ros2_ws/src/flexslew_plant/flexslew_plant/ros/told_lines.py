"""What a node tells the one who started it, on its standard output and error."""

import os
import sys


def tell(line: str, wrong: bool = False) -> None:
    """Write a line at once; where nobody reads any more it and all that follow go nowhere.

    A supervisor that was killed takes the pipe with it: its nodes end as they do at any other end.

    Args:
        line: of text.
        wrong: it is an error.
    """
    stream = sys.stderr if wrong else sys.stdout
    try:
        print(line, file=stream, flush=True)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
