"""A plant in a process of its own: a hub with a flexible boom and equations of its own.

It needs Python alone and follows the page "A plant of your own behind the bench". Fly it:
./flexslew trial docs/examples/external_plant.yaml --in-process
"""

import json
import struct
import sys

HELLO, DESCRIPTION, RESET, EFFORT, MEASUREMENT, SHUTDOWN, ERROR, BRAKE = range(1, 9)
SUBSTEPS = 10  # of the integration in a tick
State = list[float]  # [theta, q, theta', q']

# J theta'' + a q'' = u, q'' + a theta'' + 2 zeta w q' + w^2 q = 0; the boom's tip reads b q
NUMBERS = {"inertia": 120.0, "coupling": 6.0, "frequency": 2.0, "damping_ratio": 0.005, "tip": 0.4}


def read() -> tuple[int, int, int, bytes] | None:
    """Return kind, epoch, tick and body of the next message; None at the end of the input."""
    length = sys.stdin.buffer.read(4)
    if len(length) < 4:
        return None
    data = sys.stdin.buffer.read(struct.unpack("<I", length)[0])
    kind, epoch, tick = struct.unpack_from("<IIQ", data)
    return kind, epoch, tick, data[16:]


def write(kind: int, epoch: int, tick: int, body: bytes) -> None:
    """Send a message."""
    sys.stdout.buffer.write(struct.pack("<IIIQ", 16 + len(body), kind, epoch, tick) + body)
    sys.stdout.buffer.flush()


def derivative(x: State, effort: float, numbers: dict[str, float]) -> State:
    """Return the derivative of [theta, q, theta', q'] under a torque [N m]."""
    a, w = numbers["coupling"], numbers["frequency"]
    force = -2.0 * numbers["damping_ratio"] * w * x[3] - w * w * x[1]
    acceleration = (effort - a * force) / (numbers["inertia"] - a * a)
    return [x[2], x[3], acceleration, force - a * acceleration]


def advance(x: State, effort: float, h: float, numbers: dict[str, float]) -> State:
    """Return the state h later, the effort held, by the classical method of Runge and Kutta."""
    k1 = derivative(x, effort, numbers)
    k2 = derivative([a + 0.5 * h * b for a, b in zip(x, k1, strict=True)], effort, numbers)
    k3 = derivative([a + 0.5 * h * b for a, b in zip(x, k2, strict=True)], effort, numbers)
    k4 = derivative([a + h * b for a, b in zip(x, k3, strict=True)], effort, numbers)
    slopes = zip(k1, k2, k3, k4, strict=True)
    mean = [(b + 2.0 * (c + d) + e) / 6.0 for b, c, d, e in slopes]
    return [a + h * b for a, b in zip(x, mean, strict=True)]


def main() -> None:
    """Answer the bench until it ends."""
    numbers, start, period = dict(NUMBERS), 0.0, 0.01
    x: State = []
    while (message := read()) is not None:
        kind, epoch, tick, body = message
        if kind == HELLO:
            hello = json.loads(body)
            unknown = set(hello["parameters"]) - set(numbers)
            if unknown:
                words = f"parameters: {min(unknown)}: allowed: {', '.join(numbers)}"
                write(ERROR, 0, 0, words.encode())
                continue
            period, start = hello["period"], hello["initial"].get("hub", 0.0)
            numbers |= hello["parameters"]
            hub = {"name": "hub", "unit": "rad", "limit": 20.0, "initial": start}
            tips = [{"name": "boom", "unit": "m"}]
            description = {"protocol": 1, "joints": [hub], "tips": tips, "tip_rates": True}
            write(DESCRIPTION, 0, 0, json.dumps(description).encode())
            continue
        if kind == RESET:
            x = [start, 0.0, 0.0, 0.0]
        elif kind == EFFORT:
            (effort,) = struct.unpack("<d", body)
            for _ in range(SUBSTEPS):
                x = advance(x, effort, period / SUBSTEPS, numbers)
            tick += 1
        else:  # SHUTDOWN
            return
        tip = numbers["tip"]
        write(MEASUREMENT, epoch, tick, struct.pack("<4d", x[0], x[2], tip * x[1], tip * x[3]))


if __name__ == "__main__":
    main()
