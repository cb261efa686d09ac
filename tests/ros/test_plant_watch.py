"""A node that is told to end with the plant ends with it, however short the plant was there."""

from typing import Any

import pytest

from flexslew_plant.ros.graph import PlantWatch


class Seen:
    """A subscription that so many publishers are matched with, look by look; and a loop."""

    def __init__(self, *plants: int) -> None:
        self.plants = list(plants)
        self.code: int | None = None

    def get_publisher_count(self) -> int:
        return self.plants.pop(0)

    def stop(self, code: int) -> None:
        self.code = code


@pytest.mark.parametrize(
    ("looks", "heard", "enabled", "ends"),
    [
        ((0, 0), False, True, False),  # it has not come yet
        ((0, 1, 1), False, True, False),
        ((1, 0), False, True, True),
        ((0, 0), True, True, True),  # it came and went between two polls
        ((1, 0), True, False, False),
    ],
)
def test_who_watches_ends_when_the_plant_was_there_and_is_gone(
    looks: tuple[int, ...], heard: bool, enabled: bool, ends: bool
) -> None:
    graph: Any = Seen(*looks)
    watch = PlantWatch(graph, graph, enabled)
    watch.look(3)
    watch.seen = watch.seen or heard
    for _ in looks[1:]:
        watch.look(3)
    assert (graph.code == 3) == ends
