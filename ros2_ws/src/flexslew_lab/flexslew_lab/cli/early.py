"""A bench command joins the graph while the command line is still being read.

Discovery takes about as long as importing what parses the command line.
"""

from contextlib import suppress

from flexslew_lab.run.domain import bench_domain

OPERATING = (
    "brake", "controllers", "inject", "pause", "reset", "retarget", "start", "step", "switch",
)  # fmt: skip


def join(arguments: list[str]) -> None:
    """Join the graph of a bench without a namespace if this command operates one.

    Errors are reported when the command runs, which then joins by itself.
    """
    if arguments[:1] and arguments[0] in OPERATING and not _others(arguments):
        with suppress(Exception):
            domain, known = bench_domain()
            if known:
                from flexslew_lab.ros.operator import join_graph

                join_graph(domain)


def _others(arguments: list[str]) -> bool:
    """Return whether another bench may be meant, or none."""
    return any(word.startswith(("--help", "--namespace", "--all")) for word in arguments)
