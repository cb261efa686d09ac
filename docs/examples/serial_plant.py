"""A plant on a serial line: the hub with a flexible boom of external_plant.py, as a device.

It needs Python alone and follows the pages "A plant of your own behind the bench" and "From the
bench to the rig". With --own-clock it samples by its own clock, as a rig does:
python3 docs/examples/serial_plant.py --own-clock /dev/ttyUSB1
"""

import argparse
import json
import os
import select
import struct
import tty
import zlib
from time import monotonic

from external_plant import (
    BRAKE,
    DESCRIPTION,
    EFFORT,
    ERROR,
    HELLO,
    MEASUREMENT,
    NUMBERS,
    RESET,
    SUBSTEPS,
    advance,
)

HEADER = struct.Struct("<IIIQ")  # session, kind, epoch, tick


def frame(message: bytes) -> bytes:
    """Return a message with its CRC-32, coded with COBS, between two zeros."""
    coded = bytearray(b"\0")
    for part in (message + struct.pack("<I", zlib.crc32(message))).split(b"\0"):
        while len(part) >= 254:
            coded += b"\xff" + part[:254]
            part = part[254:]
        coded += bytes([len(part) + 1]) + part
    return bytes(coded) + b"\0"


def message_of(coded: bytes) -> bytes:
    """Return the message of a frame; empty: it is damaged."""
    data, at = bytearray(), 0
    while at < len(coded):
        code = coded[at]
        data += coded[at + 1 : at + code]
        at += code
        if code != 255 and at < len(coded):
            data.append(0)
    message, check = bytes(data[:-4]), bytes(data[-4:])
    whole = at == len(coded) and len(message) >= HEADER.size
    return message if whole and struct.pack("<I", zlib.crc32(message)) == check else b""


class Plant:
    """The device: answers questions, and with a clock of its own sends measurements.

    Args:
        line: descriptor of the terminal.
        own_clock: whether it samples by its own clock.
        watchdog: periods without an effort, after which it brakes by itself.
    """

    def __init__(self, line: int, own_clock: bool, watchdog: int) -> None:
        self.line, self.own_clock, self.watchdog = line, own_clock, watchdog
        self.session, self.question, self.answer = -1, b"", b""
        self.period, self.start = 0.01, 0.0
        self.epoch = self.tick = 0
        self.due = 0.0  # when its clock ticks next [s]; 0: it stands
        self.braked = True  # until a reset
        self.effort, self.newest = 0.0, 0  # that acts, and its tick
        self.x = [0.0] * 4

    def send(self, kind: int, body: bytes = b"", tick: int = 0) -> bytes:
        """Send a message; return its frame."""
        data = frame(HEADER.pack(self.session, kind, self.epoch, tick) + body)
        os.write(self.line, data)
        return data

    def measure(self) -> bytes:
        """Send the measurement of this tick."""
        x, tip = self.x, NUMBERS["tip"]
        body = struct.pack("<4d", x[0], x[2], tip * x[1], tip * x[3])
        return self.send(MEASUREMENT, body, self.tick)

    def move(self) -> None:
        """Move on by a period with the effort held."""
        for _ in range(SUBSTEPS):
            self.x = advance(self.x, self.effort, self.period / SUBSTEPS, NUMBERS)
        self.tick += 1

    def brake(self) -> None:
        """Stop all motion, and the clock."""
        self.due, self.effort, self.braked = 0.0, 0.0, True
        self.x[2:] = 0.0, 0.0  # that of a rig acts on its joints

    def receive(self, message: bytes) -> None:
        """Act on a message; a repeated question gets the stored answer."""
        session, kind, epoch, tick = HEADER.unpack_from(message)
        body = message[HEADER.size :]
        if kind == HELLO:
            self.session, self.epoch = session, 0
        elif session != self.session:
            return  # of an earlier run on the line
        if kind == EFFORT and self.own_clock:
            self.take_effort(epoch, tick, body)
            return
        if kind not in (HELLO, RESET, EFFORT, BRAKE):
            return
        if message == self.question:
            os.write(self.line, self.answer)
            return
        self.question = message
        if kind == HELLO:
            self.brake()
            self.answer = self.describe(json.loads(body))
        elif kind == RESET:
            self.brake()
            self.epoch, self.tick, self.newest, self.braked = epoch, 0, 0, False
            self.x = [self.start, 0.0, 0.0, 0.0]
            self.answer = self.measure()
        elif kind == BRAKE:
            self.brake()
            self.answer = self.send(BRAKE, tick=tick)
        elif kind == EFFORT and not self.braked and (epoch, tick) == (self.epoch, self.tick):
            (self.effort,) = struct.unpack("<d", body)
            self.move()
            self.answer = self.measure()

    def take_effort(self, epoch: int, tick: int, body: bytes) -> None:
        """Hold an effort if it is the newest; the first of an epoch starts the clock."""
        started = self.due > 0.0
        if self.braked or epoch != self.epoch or tick < self.newest or started != (tick > 0):
            return
        (self.effort,) = struct.unpack("<d", body)
        self.newest = tick
        if not started:
            self.due = monotonic() + self.period

    def describe(self, hello: dict[str, dict[str, float]]) -> bytes:
        """Send the description."""
        self.period, self.start = float(hello["period"]), hello["initial"].get("hub", 0.0)
        NUMBERS.update(hello["parameters"])
        hub = {"name": "hub", "unit": "rad", "limit": 20.0, "initial": self.start}
        tips = [{"name": "boom", "unit": "m"}]
        values = {"protocol": 1, "joints": [hub], "tips": tips, "tip_rates": True, "brake": True}
        if self.own_clock:
            values |= {"clock": "own", "period": self.period}
        return self.send(DESCRIPTION, json.dumps(values).encode())

    def sample(self) -> None:
        """Measure at a tick of its own clock; without efforts for too long, brake."""
        self.due += self.period
        self.move()
        self.measure()
        if self.tick - self.newest > self.watchdog:
            self.brake()
            words = f"no effort for {self.watchdog} periods: it brakes"
            self.send(ERROR, words.encode(), self.tick)


def main() -> None:
    """Serve the line until it is closed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--own-clock", action="store_true", help="sample by its own clock")
    parser.add_argument("--watchdog", type=int, default=20, help="periods without an effort")
    parser.add_argument("line", help="path of the serial line")
    given = parser.parse_args()
    line = os.open(given.line, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(line)
    plant, received = Plant(line, given.own_clock, given.watchdog), b""
    while True:
        wait = max(0.0, plant.due - monotonic()) if plant.due else None
        if select.select([line], [], [], wait)[0]:
            received += os.read(line, 4096)
            *frames, received = received.split(b"\0")
            for message in filter(None, map(message_of, frames)):
                plant.receive(message)
            received = received[-4096:]
        if plant.due and monotonic() >= plant.due:
            plant.sample()


if __name__ == "__main__":
    main()
