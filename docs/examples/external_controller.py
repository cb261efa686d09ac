"""A controller in a process of its own: PD with the feedforward of the plan.

It needs Python alone and follows the page "A controller as a program". Fly it:
./flexslew trial docs/examples/external_controller.yaml --in-process
"""

import json
import struct
import sys

HELLO, DESCRIPTION, RESET, EFFORT, MEASUREMENT = range(1, 6)
KP, KD = 460.0, 920.0  # [N m/rad], [N m s/rad]


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


def efforts(numbers: list[float], joints: int, tips: int) -> list[float]:
    """Return the torque of each joint [N m] from the numbers of a measurement."""
    position, velocity = numbers[:joints], numbers[joints : 2 * joints]
    reference = numbers[3 * joints + 2 * tips :]  # behind tips, root curvatures, applied efforts
    goal, rate = reference[:joints], reference[joints : 2 * joints]
    feedforward = reference[2 * joints :]
    return [
        feedforward[i] + KP * (goal[i] - position[i]) + KD * (rate[i] - velocity[i])
        for i in range(joints)
    ]


def main() -> None:
    """Answer the bench until it ends."""
    joints = tips = 0
    while (message := read()) is not None:
        kind, epoch, tick, body = message
        if kind == HELLO:
            hello = json.loads(body)
            joints, tips = len(hello["joints"]), len(hello["tips"])
            described = {"protocol": 1, "numbers": 6 * joints + 2 * tips, "efforts": joints}
            write(DESCRIPTION, 0, 0, json.dumps(described).encode())
        elif kind == RESET:  # a law with memory restarts here, from the efforts in the body
            write(RESET, epoch, tick, b"")
        elif kind == MEASUREMENT:
            numbers = list(struct.unpack(f"<{6 * joints + 2 * tips}d", body))
            write(EFFORT, epoch, tick, struct.pack(f"<{joints}d", *efforts(numbers, joints, tips)))
        else:  # SHUTDOWN
            return


if __name__ == "__main__":
    main()
