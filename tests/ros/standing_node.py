"""A node that stands still in DDS at the last tick, and so never hears that the plant has left."""

from pathlib import Path
from threading import Event, Thread, get_native_id
from typing import Any

from flexslew_plant.ros.node_process import run_node

from .guest import Guest

LAST = 499


def stand_still() -> None:
    Path(f"/proc/self/task/{get_native_id()}/comm").write_text("dds.ev.0")
    Event().wait()


class Standing(Guest):
    def __init__(self, loop: Any) -> None:
        super().__init__(loop, "standing", self._hear)

    def _hear(self, measurement: Any) -> None:
        if measurement.tick == LAST:
            Thread(target=stand_still, daemon=True).start()
            Event().wait()


def main() -> None:
    run_node(Standing)
