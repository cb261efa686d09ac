"""A plant of one joint and one tip that breaks the protocol in the way that its argument names."""

import json
import struct
import sys
import time

HELLO, DESCRIPTION, RESET, EFFORT, MEASUREMENT, SHUTDOWN, ERROR = range(1, 8)
BAD_TICK = 3  # the measurement at which it goes wrong


def write(kind: int, epoch: int, tick: int, body: bytes) -> None:
    """Send a message."""
    sys.stdout.buffer.write(struct.pack("<IIIQ", 16 + len(body), kind, epoch, tick) + body)
    sys.stdout.buffer.flush()


def main() -> None:
    """Answer; the state is the sum of the efforts."""
    way, total = sys.argv[1], 0.0
    while len(length := sys.stdin.buffer.read(4)) == 4:
        data = sys.stdin.buffer.read(struct.unpack("<I", length)[0])
        kind, epoch, tick = struct.unpack_from("<IIQ", data)
        if kind == HELLO:
            joint = {"name": "hub", "unit": "deg" if way == "unit" else "rad", "limit": 5.0}
            values = {"protocol": 1, "joints": [joint], "tips": [{"name": "boom"}]}
            values |= {"protocol": 9} if way == "protocol" else {}
            values |= {"colour": "red"} if way == "key" else {}
            write(DESCRIPTION, 0, 0, b"{" if way == "json" else json.dumps(values).encode())
            continue
        if kind == SHUTDOWN:
            return
        if kind == RESET:
            total, tick = (total if way == "memory" else 0.0), -1
        else:
            total += struct.unpack("<d", data[16:])[0]
        tick += 1
        body = struct.pack("<3d", total, 0.0, 0.1 * total)
        if tick == BAD_TICK:
            if way == "exit":
                sys.exit(4)
            if way == "hang":
                time.sleep(60.0)
            if way == "print":
                sys.stdout.buffer.write(b"debug: tick 3\n")
            if way == "error":
                write(ERROR, epoch, tick, b"the motor is too hot")
                continue
            tick += way == "tick"
            epoch += way == "epoch"
            body = struct.pack("<3d", float("nan"), 0.0, 0.0) if way == "nan" else body
            body = body[:-1] if way == "size" else body
            kind = DESCRIPTION if way == "kind" else kind
        write(DESCRIPTION if kind == DESCRIPTION else MEASUREMENT, epoch, tick, body)


if __name__ == "__main__":
    main()
