"""A node that is told to end with the plant ends with it, however short the plant was there."""

from time import monotonic
from types import SimpleNamespace
from typing import Any

import pytest

from flexslew_plant.bench.operation.presence import Heartbeat, Heartbeats
from flexslew_plant.ros.graph import UNKNOWN_NODE, PlantWatch


class Seen:
    """A node that sees these publishers, look by look, its subscription, and a loop."""

    topic_name = "/measurement"

    def __init__(self, *looks: str) -> None:
        self.looks = list(looks)
        self.code: int | None = None

    def get_publisher_count(self) -> int:
        return len(self.looks[0].split())

    def get_publishers_info_by_topic(self, _: str) -> list[SimpleNamespace]:
        return [SimpleNamespace(node_name=name) for name in self.looks[0].split()]

    def stop(self, code: int) -> None:
        self.code = code


@pytest.mark.parametrize(
    ("looks", "heard", "enabled", "ends"),
    [
        (("", ""), False, True, False),  # it has not come yet
        (("", "plant", "plant"), False, True, False),
        (("plant", ""), False, True, True),
        (("", ""), True, True, True),  # it came and went between two polls
        (("plant", ""), True, False, False),
        (("plant player", "player"), False, True, True),
        (("player", "player"), False, True, False),  # nor has it come, if another one is there
    ],
)
def test_who_watches_ends_when_the_plant_was_there_and_is_gone(
    looks: tuple[str, ...], heard: bool, enabled: bool, ends: bool
) -> None:
    graph: Any = Seen(*looks)
    presence = Heartbeats()
    presence.receive(Heartbeat("plant", "plant", 1, 1), 0.0)
    watch = PlantWatch(graph, graph, graph, presence, enabled)
    watch.look(3)
    watch.seen = watch.seen or heard
    for _ in looks[1:]:
        graph.looks.pop(0)
        watch.look(3)
    assert (graph.code == 3) == ends


@pytest.mark.parametrize("beats", [True, False])
def test_a_publisher_without_a_name_is_the_plant_as_long_as_the_plant_sends_heartbeats(
    beats: bool,
) -> None:
    """DDS reports some before their name, and leaves some over for good when many nodes die."""
    graph: Any = Seen(f"{UNKNOWN_NODE} player")
    presence, plant = Heartbeats(), Heartbeat("plant", "plant", 1, 1)
    presence.receive(plant, monotonic() + 1000.0)
    if not beats:
        presence.ended(plant)
    assert PlantWatch(graph, graph, graph, presence, True).plant_present == beats


def test_before_any_sign_of_life_whoever_publishes_is_the_plant() -> None:
    graph: Any = Seen("anybody")
    assert PlantWatch(graph, graph, graph, Heartbeats(), True).plant_present
