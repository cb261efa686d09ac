"""What a bag holds, as plain data."""

from pathlib import Path
from typing import Any

from flexslew_lab.log.bag_layout import RUN_RECORD
from flexslew_lab.log.bag_reader import BagReader

_CHECKSUM_KEYS = ("format", "checksum")


def log_info(path: Path) -> dict[str, Any]:
    """Return topics, times, trial, plans and events of a bag, ready for JSON.

    Args:
        path: the bag's folder or file.

    Raises:
        BadInput: there is no bag of this project, or it is damaged.

    """
    bag = BagReader(path)
    overview = bag.overview
    seconds = (overview.last - overview.first) * 1e-9
    testbed = overview.testbed
    return {
        "path": str(bag.path),
        "size": bag.path.stat().st_size,
        "messages": sum(overview.counts.values()),
        "start": overview.first * 1e-9,
        "duration": seconds,
        "complete": overview.cut is None,
        "cut": None if overview.cut is None else overview.cut._asdict(),
        "topics": [
            {"name": name, "type": overview.types[name], "messages": count}
            for name, count in sorted(overview.counts.items())
        ],
        "testbed": None
        if testbed is None
        else {
            "kind": testbed.kind,
            "joints": list(testbed.joint_names),
            "modes": int(testbed.modes),
            "period": float(testbed.period),
        },
        "plans": [
            {"method": p.method, "hash": p.hash, "start": p.start, "duration": p.duration}
            for p in overview.plans
        ],
        "controllers": {name: s.law for name, s in sorted(overview.statuses.items())},
        "events": [event.plain() for event in overview.events],
        "recorded": {k: v for k, v in bag.metadata.items() if k not in _CHECKSUM_KEYS},
        "ended": {
            k: v
            for k, v in overview.metadata.get(RUN_RECORD, {}).items()
            if k not in _CHECKSUM_KEYS
        },
    }
