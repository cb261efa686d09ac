"""Ticks of an external plant per second, beside a bare exchange of the same bytes."""

import socket
import struct
import subprocess
from pathlib import Path
from shutil import which
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import numpy as np

from flexslew_plant.bench.bench import Bench, BenchSettings
from flexslew_plant.external.messages import MessageKind, encoded, json_bytes, number_bytes
from flexslew_plant.measurement import EffortCommand
from flexslew_plant.own_code import ANY_CODE
from flexslew_plant.testbeds import read_testbed

_SOURCE = Path(__file__).parents[1] / "docs" / "examples" / "external_plant.c"
_TICKS, _ROUNDS, _PERIOD = 10000, 3, 0.01


def figures() -> dict[str, float]:
    """Return the rates, the best of some rounds each; none without a C compiler.

    external_ticks_per_s: of a bench with the C plant of the documentation.
    external_raw_ticks_per_s: of the bare exchange of the same bytes with the same program.
    external_share_of_raw: the first over the second.
    external_builtin_ticks_per_s: of a bench with two joints and one mode of its own.
    """
    compiler = which("cc") or which("gcc") or which("clang")
    if compiler is None:
        return {}
    with TemporaryDirectory() as folder:
        program = str(Path(folder) / "plant")
        subprocess.run([compiler, "-std=c99", "-O2", str(_SOURCE), "-o", program], check=True)
        external = {"kind": "external", "command": [program]}
        builtin = {"kind": "csa", "modes": 1}
        rounds = [(_raw(program), _bench(external), _bench(builtin)) for _ in range(_ROUNDS)]
    raw, bench, own = map(float, np.max(rounds, axis=0))
    return {
        "external_ticks_per_s": bench,
        "external_raw_ticks_per_s": raw,
        "external_share_of_raw": bench / raw,
        "external_builtin_ticks_per_s": own,
    }


def _bench(section: dict[str, Any]) -> float:
    """Return the ticks per second of a bench, each answered with zero efforts."""
    testbed = read_testbed(section, "benchmark", ANY_CODE)
    bench = Bench(BenchSettings(testbed=testbed, period=_PERIOD, duration=_TICKS * _PERIOD))
    effort, start = np.zeros(2), perf_counter()
    while not bench.done:
        asked = bench.question
        bench.offer(EffortCommand(asked.tick, asked.epoch, asked.controller, effort))
        bench.advance()
    rate = _TICKS / (perf_counter() - start)
    bench.close()
    return rate


def _raw(program: str) -> float:
    """Return the exchanges per second of the bytes of a tick, without a look at them."""
    ours, theirs = socket.socketpair()
    process = subprocess.Popen([program], stdin=theirs.fileno(), stdout=theirs.fileno())
    theirs.close()
    hello = {"protocol": 1, "period": _PERIOD, "parameters": {}, "initial": {}}
    for message in (encoded(MessageKind.HELLO, body=json_bytes(hello)), encoded(MessageKind.RESET)):
        ours.sendall(struct.pack("<I", len(message)) + message)
        ours.recv(1 << 16)
    message = encoded(MessageKind.EFFORT, body=number_bytes(np.zeros(2)))
    frame = struct.pack("<I", len(message)) + message
    size, start = 4 + 16 + 6 * 8, perf_counter()
    for _ in range(_TICKS):
        ours.sendall(frame)
        got = 0
        while got < size:
            got += len(ours.recv(size - got))
    rate = _TICKS / (perf_counter() - start)
    ours.close()
    process.wait()
    return rate
