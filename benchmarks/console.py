"""What a console costs: its process and the bench beside it, at real time and as fast as it goes.

One trial is flown at real time, fast, and fast with the console killed at its start; a page without
a browser is connected to it. Charts count four a frame. The delay is that of a chart's newest tick
beyond the smallest one that was met.
"""

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from threading import Thread
from typing import Any

import msgspec
import numpy as np
import viser
import zstandard
from viser import _messages
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol

from flexslew_lab.log.bag_reader import BagReader

SECONDS = 20.0  # of each run [wall s]
TRIAL = """
name: console_benchmark
duration: {duration}
controllers: {{pd_feedforward: {{}}}}
"""


class Listener:
    """A page that counts what it is sent."""

    def __init__(self, address: str) -> None:
        port = address.split(":")[2].split("/")[0]
        self._socket = connect(
            address.replace("http", "ws", 1),
            origin=Origin(f"http://127.0.0.1:{port}"),
            subprotocols=[Subprotocol(f"viser-v{viser.__version__}")],
            max_size=None,
        )
        self.charts: list[tuple[float, float]] = []  # wall time, newest simulated time [s]
        Thread(target=self._hear, daemon=True).start()
        zero = (0.0, 0.0, 0.0)
        camera = _messages.ViewerCameraMessage(
            (1.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 1.0, 0.1, 10.0, 100, 100, zero, (0.0, 0.0, 1.0)
        )
        self.send(camera.as_serializable_dict([]))
        self.buttons: dict[str, str] = {}

    def send(self, message: dict[str, Any]) -> None:
        """Send a message of viser's protocol."""
        self._socket.send(msgspec.msgpack.encode(message))

    def click(self, label: str) -> None:
        """Press the button of this name as soon as it is there."""
        while label not in self.buttons:
            time.sleep(0.05)
        uuid = self.buttons[label]
        self.send({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": True}})

    def _hear(self) -> None:
        decompress = zstandard.ZstdDecompressor().decompress
        try:
            for data in self._socket:
                self._take(bytes(data), decompress)  # type: ignore[arg-type]
        except ConnectionClosed:
            return

    def _take(self, data: bytes, decompress: Any) -> None:
        size = int.from_bytes(data[8:16], "little")
        found = msgspec.msgpack.decode(decompress(data[16 : 16 + size]))
        place, starts = 16 + size, []
        for length in found["binaryBufferLengths"]:
            place += -place % 8
            starts.append((place, length))
            place += length
        for message in found["messages"]:
            label = str((message.get("props") or {}).get("label"))
            if message["type"] == "GuiButtonMessage":
                self.buttons[label] = message["uuid"]
            rows = (message.get("updates") or {}).get("data")
            if rows:
                start, length = starts[rows[0]["__binary_index"]]
                axis = np.frombuffer(data[start : start + length])
                self.charts.append((time.monotonic(), float(axis[-1])))


def flown(folder: Path, rate: float, seconds: float, watched: bool) -> dict[str, float]:
    """Fly for so many seconds of wall time; return what was measured."""
    trial = folder / "trial.yaml"
    trial.write_text(TRIAL.format(duration=1e6))
    out = folder / f"run-{rate:g}-{watched}"
    command = [sys.executable, "-m", "flexslew_lab.cli.main", "console", str(trial)]
    command += ["--port", "0", "--out", str(out), "--rate", str(rate)]
    child = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    assert child.stderr is not None
    address = next(line for line in child.stderr if line.startswith("open ")).split()[1]
    Thread(target=child.stderr.read, daemon=True).start()
    page = Listener(address)
    while not (out / "bag").exists():
        time.sleep(0.1)
    time.sleep(3.0)
    page.click("Start")
    pid = _console_of(child.pid)
    time.sleep(3.0)
    if not watched:
        os.kill(pid, signal.SIGKILL)
    before, start = _cpu(pid) if watched else 0.0, time.monotonic()
    time.sleep(seconds)
    used = (_cpu(pid) - before if watched else 0.0) / (time.monotonic() - start)
    charts = [(w, t) for w, t in page.charts if w > start]
    child.send_signal(signal.SIGINT)
    child.wait(120)
    overview = BagReader(out / "bag").overview
    ticks = overview.counts["/truth"]
    result = {"ticks_per_second": ticks / (seconds + 3.0), "cores": used}
    if charts and rate:
        ahead = np.array([w - t / rate for w, t in charts])
        result["delay_p95"] = float(np.percentile(ahead - ahead.min(), 95))
    if charts:
        result["charts_per_second"] = len(charts) / seconds
    return result


def _console_of(parent: int) -> int:
    found = subprocess.run(
        ["ps", "-o", "pid=,args=", "--ppid", str(parent)],
        capture_output=True,
        text=True,
        check=True,
    )
    lines = [line.split(None, 1) for line in found.stdout.splitlines()]
    return next(int(pid) for pid, words in lines if "console_node" in words)


def _cpu(pid: int) -> float:
    """Return the processor time of a process [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def figures() -> dict[str, float]:
    """Return cores, frames a second and delay of a console, and what it costs a fast bench."""
    with tempfile.TemporaryDirectory() as folder:
        real = flown(Path(folder), 1.0, SECONDS, True)
        fast = flown(Path(folder), 0.0, SECONDS, True)
        alone = flown(Path(folder), 0.0, SECONDS, False)
    return {
        "console_cores_at_rate_1": real["cores"],
        "console_cores_fast": fast["cores"],
        "console_delay_p95_above_the_fastest": real.get("delay_p95", float("nan")),
        "charts_per_second_at_rate_1": real.get("charts_per_second", 0.0),
        "charts_per_second_fast": fast.get("charts_per_second", 0.0),
        "tick_rate_fast_to_that_without_a_console": (
            fast["ticks_per_second"] / alone["ticks_per_second"]
        ),
    }
