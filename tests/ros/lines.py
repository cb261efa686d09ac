"""Flights on lines, over DDS, or both at once: how each was asked, and what must hold."""

import socket
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.checks.check import check_log
from flexslew_lab.replay.resim import resim
from flexslew_lab.run.processes import NodeProcess
from flexslew_lab.run.run_trial import run_trial
from flexslew_plant.direct.names import address

PER_TICK = ("/measurement", "/effort_command", "/controller_state")


def alone(trial: Any, folder: Path) -> Any:
    """Return the hash of the trajectory that the trial has in process."""
    result = run_trial(trial, "test", folder / "alone", in_process=True, report=False)
    return result.metrics["trajectory_hash"]


def asked(bag: Path) -> dict[str, set[str]]:
    """Return how each controller was asked, as the events say."""
    found: dict[str, set[str]] = {}
    for event in BagReader(bag).overview.events:
        if event.kind == "transport":
            found.setdefault(event.data["controller"], set()).add(event.data["transport"])
    return found


def whole(bag: Path, ticks: int) -> None:
    """Check that a log has every message of every tick, and flies again to the same bits."""
    overview = BagReader(bag).overview
    every_tick(bag, ticks)
    assert [finding for finding in check_log(bag) if not finding.ok] == []
    assert {"stray", "rejected", "missed"}.isdisjoint(event.kind for event in overview.events)
    assert resim(bag).identical


def over_dds(names: Collection[str]) -> Callable[[NodeProcess], NodeProcess]:
    """Return what makes these controllers nodes that are asked over DDS."""
    return lambda node: (
        node._replace(package="tests", executable="over_dds") if node.name in names else node
    )


class Strangers:
    """Those who call on a socket of the bench, say something and stay.

    Args:
        answers: of the socket's name, see names.address.
    """

    def __init__(self, answers: str) -> None:
        self._answers = answers
        self.lines: list[socket.socket] = []

    def call(self, domain: int, *words: bytes) -> None:
        """Call, and say these words."""
        caller = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        caller.connect(address(domain, "/measurement", self._answers))
        for word in words:
            caller.send(word)
        self.lines.append(caller)

    def close(self) -> None:
        """Hang up."""
        for line in self.lines:
            line.close()


def every_tick(bag: Path, ticks: int) -> None:
    """Check that a log has question, answer and state of every tick.

    More than once where the machine held somebody up for so long that the question was repeated.
    """
    for topic in PER_TICK:
        assert {*BagReader(bag).columns(topic, {"tick"})["tick"].tolist()} == {*range(ticks)}
