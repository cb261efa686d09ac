"""A live bench under pages that click anything, hang, or lose their console."""

import os
import random
import re
import signal
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from threading import Thread
from time import monotonic, sleep
from typing import Any

import numpy as np
import pytest

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.replay.resim import resim
from flexslew_lab.ros.operator import connected
from flexslew_lab.run.processes import NodeProcess
from flexslew_lab.run.run_trial import run_trial
from tests.page_client import PageClient
from tests.ros.console_page import console, trial_file
from tests.ros.flight import Flight, slew

pytestmark = pytest.mark.ros

ACTIONS = 400  # of each
ODD = [
    0.0, 1.0, 7, -1, float("nan"), 1e300, "lqr", "5.0", "[500.0, 500.0]", "", "soon", "{", True,
    "x" * 5000, None, [1, 2],
]  # fmt: skip
ENDS = re.compile("effort|amplitude|gain")  # where 1e300 ends the run: its state is lost
WALL = 120.0  # for one thing to happen on a busy machine [s]


@pytest.mark.alone  # clicks faster than the page of a busy machine asks
@pytest.mark.timeout(1200)
@pytest.mark.share(0.1)
def test_a_bench_stays_whole_whatever_is_clicked_and_flies_again(
    tmp_path: Path, case: np.random.Generator
) -> None:
    rng, run = random.Random(int(case.integers(2**32))), tmp_path / "run"
    with console(str(trial_file(tmp_path, 1e4)), "--out", str(run), "--rate", "5") as (_, address):
        page, other = PageClient(address), PageClient(address)
        until(lambda: any("lqr" in e.get("options", ()) for e in page.inputs.values()), page)
        page.set(page.named("Start"), True)
        until(lambda: ">running<" in page.text, page)
        for number in range(ACTIONS):
            uuid, element = rng.choice(sorted(page.inputs.items(), key=lambda it: it[1]["label"]))
            page.set(uuid, anything(rng, element))
            reach(page, run)
            if number % 5 == 0:
                press(page, "Start")
        until(lambda: (run / "bag").exists(), page)
        page.set(page.named("Remark"), "the end")
        page.set(page.named("Note it"), True)
        until(lambda: "noted at tick" in page.text, page)

        def paused() -> bool:  # a start that was clicked before may come after a pause
            press(page, "Pause")
            return ">paused<" in page.text

        until(paused, page)
        late = PageClient(address)
        until(lambda: paused() and shown(other, "value") == shown(late, "value"), other, late)
        until(lambda: paused() and shown(page) == shown(other), page, other)
    events = BagReader(run / "bag").overview.events
    # most of the hundred inputs are fields and choices, whose values act with a button only
    assert sum(", page " in str(e.data.get("who", "")) for e in events) > ACTIONS / 40
    assert "the end" in [e.message for e in events if e.kind == "note"]
    assert "Traceback" not in (run / "nodes.log").read_text()
    assert resim(run / "bag").identical


def press(page: PageClient, label: str) -> None:
    """Press the button with this label, if the page shows it now."""
    for uuid, element in page.inputs.items():
        if element["label"] == label and element["visible"]:
            page.set(uuid, True)


def test_a_hung_page_and_a_killed_console_change_no_bit(tmp_path: Path) -> None:
    trial = slew(duration=600.0)
    alone = run_trial(trial, "test", tmp_path / "alone", in_process=True, report=False)
    killed: list[str] = []

    def disturb(console: int, domain: int) -> None:
        address = opened(tmp_path / "flight" / "nodes.log")
        pages = [PageClient(address, hangs=True), PageClient(address)]
        with connected(domain, patience=WALL) as bench:
            bench.act("start")
        until(lambda: ">running<" in pages[1].text, pages[1])
        os.kill(console, signal.SIGKILL)
        killed.append(pages[1].text)

    def begin(pids: dict[str, int], domain: int) -> None:
        # beside the supervisor, which goes on to read what the nodes print
        Thread(target=disturb, args=(pids["console"], domain)).start()

    viewer = NodeProcess("console", "flexslew_lab", "console", {"port": 0})
    flight = Flight(trial, tmp_path / "flight", extra=[viewer], begin=begin)
    assert killed
    assert flight.metrics["trajectory_hash"] == alone.metrics["trajectory_hash"]


def reach(page: PageClient, run: Path) -> None:
    """Wait for the console to have read what was sent; if it does not, tell where it stands."""
    try:
        page.reach()
    except TimeoutError:
        for cmdline in Path("/proc").glob("[0-9]*/cmdline"):
            with suppress(OSError):  # one that has just ended
                words = cmdline.read_bytes()
                if b"console_node" in words and str(run).encode() in words:
                    os.kill(int(cmdline.parent.name), signal.SIGUSR1)
        sleep(2.0)  # it writes its stacks without Python, which may be what is held up
        pytest.fail((run / "nodes.log").read_text()[-20_000:])


def opened(log: Path) -> str:
    """Return where the console says that its page is, as soon as it does."""
    end = monotonic() + WALL
    while not (found := re.search(r"open (\S+)\n", log.read_text())):
        assert monotonic() < end, log.read_text()
        sleep(0.02)
    return found[1]


def anything(rng: random.Random, element: dict[str, Any]) -> Any:
    """Return what a page may send for an element: half of it is of use."""
    if element["kind"] == "button":
        return True
    if rng.random() < 0.5:
        return rng.choice([x for x in ODD if x != 1e300 or not ENDS.search(element["label"])])
    if element["options"]:
        return rng.choice(element["options"])
    return element["value"]


def shown(page: PageClient, *more: str) -> list[Any]:
    """Return the fields and the texts of a page; what it has written itself it is not told."""
    keys = ("kind", "label", "options", "visible")
    fields = []
    for element in page.inputs.values():
        value = str(element["value"])
        number = value.removesuffix(".0")  # a browser is told 7.0 at first, and 7 later
        fields.append(str([*(element[key] for key in keys), number if "value" in more else ""]))
    return [sorted(fields), sorted(filter(None, page.text.splitlines()))]


def until(condition: Callable[[], bool], *pages: PageClient) -> None:
    end = monotonic() + WALL
    while not condition():
        assert monotonic() < end, pages[0].text
        for page in pages:
            page.reach()
