"""Lines for the process that started this node, on its standard output and error."""

import os
import sys


def write_line(line: str, wrong: bool = False) -> None:
    """Write a line at once; once the reader is gone, it and all later ones are discarded.

    A supervisor that was killed takes the pipe with it: its nodes end as they do at any other end.

    Args:
        line: one line of text.
        wrong: True for an error.
    """
    stream = sys.stderr if wrong else sys.stdout
    try:
        print(line, file=stream, flush=True)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
