"""What a console with its page costs: at real time, and as fast as the bench goes.

A page in headless Chromium shows four charts and the bench in three dimensions. Each run is flown
again without it: the console leaves at the start. The delay is from a tick's message, as another
listener hears it, to the page that shows its time. FLEXSLEW_BENCH_SECONDS says how long each run
takes.
"""

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread
from typing import Any

import numpy as np
import rclpy
from rclpy.node import Node

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tests.browser import Browser, chromium
from tests.page_client import PageClient

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.messages.cdr import stamp_of
from flexslew_lab.ros.hidden_listener import HiddenListener
from flexslew_lab.run.domain import locked_domain
from flexslew_plant.graph.topics import TOPICS, TRUTH

SECONDS = float(os.environ.get("FLEXSLEW_BENCH_SECONDS", "60"))  # of each run [wall s]
SETTLE = 5.0  # before the start, and between it and what is measured [wall s]
PAIRS = 3  # of fast runs, with and without the page
TRIAL = """
name: console_benchmark
duration: 1.0e6
controllers: {pd_feedforward: {}}
schedule:  # it swings, so that the page has something to draw
  - {at: 0.0, disturbance: {base_yaw: {sine: {amplitude: 100.0, frequency: 0.05}}}}
"""
# without a loop of its own, which would have the browser draw frames that nobody asked for
WATCH = """
window.seen = []; let last = "";
new MutationObserver(() => {
  const said = document.getElementById("bench-state")?.textContent || "";
  const found = said.match(/([0-9.]+) s tick/);
  if (found && found[1] !== last) { last = found[1]; window.seen.push([Date.now(), +last]); }
}).observe(document.body, {subtree: true, childList: true, characterData: true});
"""


def flown(rate: float, seconds: float, watched: bool) -> dict[str, float]:
    """Fly for so many seconds of wall time, with a page or without a console."""
    with tempfile.TemporaryDirectory() as name, locked_domain() as domain, chromium() as browser:
        folder = Path(name)
        (folder / "trial.yaml").write_text(TRIAL)
        with _console(folder, rate, domain) as (child, address), _heard(domain) as arrivals:
            hands = PageClient(address)
            if watched:
                browser.open(address, 1300, 1000)
                browser.until("return document.getElementById('bench-state')")
                browser.run(WATCH)
            time.sleep(SETTLE)
            while not _clicked(hands, "Start"):
                time.sleep(0.05)
            while ">running<" not in hands.text:
                time.sleep(0.05)
            hands.socket.close()
            server = _console_of(child.pid)
            if not watched:
                os.kill(server, signal.SIGINT)  # a dead one would be waited for
            time.sleep(SETTLE)
            measured = _measured(browser, server, arrivals, seconds, watched)
        events = BagReader(folder / "run" / "bag").overview.events
    missed = [e for e in events if e.kind == "missed"]
    return {**measured, "missed": float(len(missed))}


def _measured(
    browser: Browser, server: int, arrivals: dict[float, float], seconds: float, watched: bool
) -> dict[str, float]:
    pages = [pid for pid in _descendants(os.getpid()) if "chrom" in _comm(pid)]
    if watched:
        browser.run("window.seen.length = 0")
    before = _cpu([server]), _cpu(pages), max(arrivals)
    start = time.monotonic()
    time.sleep(seconds)
    wall = time.monotonic() - start
    result = {"ticks_per_second": (max(arrivals) - before[2]) * 100.0 / wall}
    if watched:
        seen = browser.run("return window.seen")
        late = [at / 1000.0 - arrivals[t] for at, t in seen if t in arrivals]
        result |= {
            "server_cores": (_cpu([server]) - before[0]) / wall,
            "page_cores": (_cpu(pages) - before[1]) / wall,
            "frames_per_second": len(seen) / wall,
            "delay_p95": float(np.percentile(late, 95)) if late else float("nan"),
            "delay_median": float(np.median(late)) if late else float("nan"),
        }
    return result


@contextmanager
def _console(
    folder: Path, rate: float, domain: int
) -> Iterator[tuple["subprocess.Popen[str]", str]]:
    """Yield the process of a console with its bench, and the address of its page."""
    command = [sys.executable, "-m", "flexslew_lab.cli.main", "console", str(folder / "trial.yaml")]
    child = subprocess.Popen(
        [*command, "--port", "0", "--out", str(folder / "run"), "--rate", str(rate)],
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "ROS_DOMAIN_ID": str(domain), "PYTHONUNBUFFERED": "1"},
    )
    assert child.stderr is not None
    try:
        address = next(line for line in child.stderr if line.startswith("open ")).split()[1]
        Thread(target=child.stderr.read, daemon=True).start()
        yield child, address
    finally:
        child.send_signal(signal.SIGINT)
        child.wait(120)


@contextmanager
def _heard(domain: int) -> Iterator[dict[float, float]]:
    """Yield when each simulated time was heard first, by wall clock; it goes on filling."""
    arrivals, over = {0.0: 0.0}, Event()
    rclpy.init(domain_id=domain)
    node = Node("benchmark")
    listener = HiddenListener(node, {TRUTH: TOPICS[TRUTH]})

    def listen() -> None:
        while not over.wait(0.002):
            for _, data, _ in listener.take():
                arrivals[round(stamp_of(TOPICS[TRUTH].type, data, 0) * 1e-9, 2)] = time.time()

    thread = Thread(target=listen)
    thread.start()
    try:
        yield arrivals
    finally:
        over.set()
        thread.join()
        listener.close()
        node.destroy_node()
        rclpy.shutdown()


def _clicked(page: PageClient, label: str) -> bool:
    there = [uuid for uuid, e in page.inputs.items() if e["label"] == label]
    if there:
        page.set(there[0], True)
    return bool(there)


def _console_of(parent: int) -> int:
    return next(pid for pid in _descendants(parent) if "console_node" in _command(pid))


def _descendants(parent: int) -> list[int]:
    children: dict[int, list[int]] = {}
    for place in Path("/proc").glob("[0-9]*"):
        try:
            above = int((place / "stat").read_text().rsplit(")", 1)[1].split()[1])
        except OSError:
            continue
        children.setdefault(above, []).append(int(place.name))
    found, rest = [], [parent]
    while rest:
        rest += (below := children.get(rest.pop(), []))
        found += below
    return found


def _command(pid: int) -> str:
    return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()


def _comm(pid: int) -> str:
    return Path(f"/proc/{pid}/comm").read_text()


def _cpu(pids: list[int]) -> float:
    """Return the processor time of processes [s]."""
    used: Any = 0
    for pid in pids:
        fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
        used += int(fields[11]) + int(fields[12])
    return float(used) / os.sysconf("SC_CLK_TCK")


def figures() -> dict[str, float]:
    """Return what a page costs at rate 1 and fast, and how soon it shows what is flown."""
    real, alone = flown(1.0, SECONDS, True), flown(1.0, SECONDS, False)
    short = min(SECONDS, 20.0)
    fast = [(flown(0.0, short, True), flown(0.0, short, False)) for _ in range(PAIRS)]
    shares = [with_page["ticks_per_second"] / bare["ticks_per_second"] for with_page, bare in fast]
    return {
        "console_missed_ticks_at_rate_1": real["missed"],
        "console_missed_ticks_at_rate_1_without_it": alone["missed"],
        "console_delay_median_at_rate_1": real["delay_median"],
        "console_delay_p95_at_rate_1": real["delay_p95"],
        "console_server_cores_at_rate_1": real["server_cores"],
        "console_page_cores_at_rate_1": real["page_cores"],
        "console_frames_per_second_at_rate_1": real["frames_per_second"],
        "console_frames_per_second_fast": fast[0][0]["frames_per_second"],
        "console_server_cores_fast": fast[0][0]["server_cores"],
        "console_fast_ticks_per_second_without_it": fast[0][1]["ticks_per_second"],
        "console_fast_tick_rate_to_that_without_it": float(np.median(shares)),
    }
