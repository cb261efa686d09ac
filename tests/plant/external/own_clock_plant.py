"""A plant with a clock of its own on its standard streams; its joint stands at its tick."""

import json
import os
import select
import struct
import sys
from time import monotonic

HELLO, DESCRIPTION, RESET, EFFORT, MEASUREMENT, SHUTDOWN, ERROR, BRAKE = range(1, 9)
PERIOD = 0.02  # [s]


def write(kind: int, epoch: int, tick: int, body: bytes = b"") -> None:
    """Send a message."""
    os.write(1, struct.pack("<IIIQ", 16 + len(body), kind, epoch, tick) + body)


def main() -> None:
    """Measure at its own time from the first effort to the brake."""
    received, due, epoch, tick = b"", 0.0, 0, 0
    joint = {"name": "hub", "unit": "rad", "limit": 5.0}
    values = {"protocol": 1, "joints": [joint], "clock": "own", "period": PERIOD, "brake": True}
    while True:
        if select.select([0], [], [], max(0.0, due - monotonic()) if due else None)[0]:
            data = os.read(0, 4096)
            if not data:
                sys.exit(0)
            received += data
        while len(received) >= 20:
            size, kind, epoch_asked, tick_asked = struct.unpack_from("<IIIQ", received)
            received = received[4 + size :]  # the efforts do not move it
            if kind == SHUTDOWN:
                sys.exit(0)
            if kind == HELLO:
                write(DESCRIPTION, 0, 0, json.dumps(values).encode())
            elif kind == RESET:
                epoch, tick, due = epoch_asked, 0, 0.0
                write(MEASUREMENT, epoch, 0, struct.pack("<2d", 0.0, 0.0))
            elif kind == EFFORT and not due and not tick:
                due = monotonic() + PERIOD
            elif kind == BRAKE:
                due = 0.0
                write(MEASUREMENT, epoch, tick, struct.pack("<2d", 0.0, 0.0))  # one more
                write(BRAKE, epoch_asked, tick_asked)
        if due and monotonic() >= due:
            due, tick = due + PERIOD, tick + 1
            write(MEASUREMENT, epoch, tick, struct.pack("<2d", float(tick), 0.0))


if __name__ == "__main__":
    main()
