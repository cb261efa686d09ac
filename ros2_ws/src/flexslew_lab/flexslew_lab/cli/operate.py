"""Subcommands for a bench that runs: start, pause, step, reset, brake, inject, switch."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated

import typer

from flexslew_lab.cli.options.quantity import quantity
from flexslew_lab.cli.options.shared import Json
from flexslew_lab.cli.terminal import print_message, print_table
from flexslew_lab.json_text import json_text
from flexslew_lab.run.domain import (
    RunningBench,
    bench_without_lock,
    default_bench,
    running_benches,
)
from flexslew_lab.short_values import short
from flexslew_plant.errors import BadInput, FlexslewError

if TYPE_CHECKING:
    from flexslew_lab.ros.operator import Operator
    from flexslew_plant.refusal import Reply

_FALLBACK_TIMEOUT = 1.5  # patience where no run has left its domain [wall s]

Namespace = Annotated[str, typer.Option(help="Namespace of the bench, if it has one.")]
At = Annotated[
    float, typer.Option(parser=quantity("s"), help="Simulated time [s]; 0: the next tick.")
]


def start(namespace: Namespace = "") -> None:
    """Start a waiting bench, or resume a paused one.

    Example: `./flexslew start`
    """
    _done(namespace, lambda bench: bench.act("start"))


def pause(namespace: Namespace = "") -> None:
    """Stop a running bench between two ticks.

    Example: `./flexslew pause`
    """
    _done(namespace, lambda bench: bench.act("pause"))


def step(
    ticks: Annotated[int, typer.Argument(help="Number of ticks.")] = 1, namespace: Namespace = ""
) -> None:
    """Advance a paused bench by some ticks.

    Example: `./flexslew step 100`
    """
    if not 1 <= ticks < 2**32:
        raise BadInput("at least 1, below 2^32", key="ticks", value=ticks)
    _done(namespace, lambda bench: bench.step(ticks))


def reset(namespace: Namespace = "") -> None:
    """Return the bench to tick 0 and pause it there.

    Example: `./flexslew reset`
    """
    _done(namespace, lambda bench: bench.act("reset"))


def brake(
    release: Annotated[bool, typer.Option("--release", help="Take the brake off.")] = False,
    every: Annotated[
        bool, typer.Option("--all", help="Brake all your benches on this machine.")
    ] = False,
    namespace: Namespace = "",
) -> None:
    """Stop the joints with the drive's own brake from the next tick on, until it is released.

    Example: `./flexslew brake`
    """
    if every:
        _brake_all(namespace, release)
        return
    _done(namespace, lambda bench: bench.act("release_brake" if release else "brake"))


def inject(
    what: Annotated[str, typer.Argument(help="A fault or disturbance as in a schedule, YAML.")],
    at: At = 0.0,
    namespace: Namespace = "",
) -> None:
    """Inject a fault or disturbance into a running bench whose trial has allow_faults: true.

    Example: `./flexslew inject "{kind: command_lost, probability: 0.2}"`
    """
    _require("--at", at)
    _done(namespace, lambda bench: bench.inject(what, at))


def retarget(
    target: Annotated[str, typer.Argument(help="An appendage and where it turns, YAML.")],
    at: At = 0.0,
    namespace: Namespace = "",
) -> None:
    """Give an antenna on a prescribed hinge a new target while the bench runs.

    Example: `./flexslew retarget "{appendage: first, to: 0.3, duration: 2.0}"`
    """
    _require("--at", at)
    _done(namespace, lambda bench: bench.retarget(target, at))


def controllers(as_json: Json = False, namespace: Namespace = "") -> None:
    """List the controllers of a running bench, who is ready and who is in charge.

    Example: `./flexslew controllers`
    """
    which = _selected_bench()
    with _bench(namespace, which) as bench:
        active, rows = bench.controllers()
    if as_json:
        print(json_text({"active": active, "controllers": rows}))
    else:
        columns = ("controller", "law", "ready", "reason", "last_tick")
        table = [[short(row[c]) for c in columns] for row in rows]
        print_table(("in charge", *columns), [["*" * (r[0] == active), *r] for r in table])
        print_message(which.words)


def switch(
    controller: Annotated[str, typer.Argument(help="Controller that takes over.")],
    at: At = 0.0,
    strict: Annotated[bool, typer.Option(help="Refuse a larger step of the effort.")] = False,
    max_effort_step: Annotated[float, typer.Option(help="For --strict [N m].")] = 1.0,
    namespace: Namespace = "",
) -> None:
    """Give the bench to another controller while it moves.

    Example: `./flexslew switch output_feedback --at 12.5`
    """
    _require("--at", at)
    _require("--max-effort-step", max_effort_step)
    _done(namespace, lambda bench: bench.switch(controller, at, strict, max_effort_step))


COMMANDS = (controllers, switch, start, pause, step, reset, brake, inject, retarget)


@contextmanager
def _bench(namespace: str, which: RunningBench) -> Iterator["Operator"]:
    from flexslew_lab.ros.operator import PATIENCE, connected  # or the error without ROS

    with connected(
        which.domain, namespace, PATIENCE if which.known else _FALLBACK_TIMEOUT
    ) as bench:
        try:
            yield bench
        except FlexslewError as error:
            hint = f" (domain {which.domain}; no run of yours on this machine is under way)"
            raise FlexslewError(f"{error}{'' if which.known else hint}") from None


def _selected_bench() -> RunningBench:
    """Return the bench that is meant; without ROS, raise the error before a user has to choose."""
    import flexslew_lab.ros.operator  # noqa: F401

    return default_bench()


def _done(namespace: str, request: Callable[["Operator"], "Reply"]) -> None:
    """Print what the bench answers, and which it is; leave with exit code 1 if it refuses."""
    which = _selected_bench()
    with _bench(namespace, which) as bench:
        reply = request(bench)
    if not _print_reply(reply, which):
        raise typer.Exit(1)


def _print_reply(reply: "Reply", which: RunningBench, place: str = "") -> bool:
    """Print the answer of a bench, and which it is; return whether it grants the request."""
    where = f", namespace {place}" if place else ""
    print_message(f"{reply.message} ({which.words}{where})")
    return reply.ok


def _brake_all(namespace: str, release: bool) -> None:
    """Brake each bench of this user; exit code 1 if one of them did not."""
    found, unclaimed, failed = running_benches(), bench_without_lock(), False
    action, brake_count = "release_brake" if release else "brake", len(found)
    for which in [*found, *unclaimed]:
        try:
            with _bench(namespace, which) as bench:
                for place, reply in bench.act_everywhere(action):
                    failed |= not _print_reply(reply, which, place)
                    brake_count += which in unclaimed
        except FlexslewError as error:  # the others are braked all the same
            if which not in unclaimed:
                failed = True
                print_message(f"{error} ({which.words})")
    if not brake_count:
        raise BadInput("no bench of yours runs on this machine", key="--all")
    if failed:
        raise typer.Exit(1)


def _require(option: str, value: float) -> None:
    if not 0.0 <= value < math.inf:
        raise BadInput("at least 0, finite", key=option, value=value)
