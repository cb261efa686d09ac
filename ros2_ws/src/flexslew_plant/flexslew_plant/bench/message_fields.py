"""Records of the bench as the fields of their messages, for nodes and for the log alike."""

import json
from typing import Any

from flexslew_plant.bench.bench import Bench
from flexslew_plant.bench.wire import stamp_of
from flexslew_plant.events import Event
from flexslew_plant.settings import plain
from flexslew_plant.yaml_data import yaml_text


def event_fields(event: Event) -> dict[str, Any]:
    """Return the fields of flexslew_msgs/Event; the stamp is a wire.Stamp."""
    return {
        "stamp": stamp_of(event.time),
        "tick": event.tick,
        "epoch": event.epoch,
        "level": event.level.number,
        "source": event.source,
        "kind": event.kind,
        "message": event.message,
        "data": json.dumps(event.data),
    }


def testbed_fields(bench: Bench, settings: Any) -> dict[str, Any]:
    """Return the fields of flexslew_msgs/Testbed but for its stamp.

    Args:
        bench: that stands there.
        settings: of the plant, as sections.
    """
    return {
        "kind": bench.settings.testbed.kind,
        "joint_names": list(bench.model.joint_names),
        "joint_units": list(bench.model.joint_units),
        "appendage_names": list(bench.appendages.names),
        "modes": bench.model.modes,
        "period": bench.settings.period,
        "effort_limit": bench.limit,
        "settings": yaml_text(plain(settings)),
    }
