"""Speed of the log: writing against the bare mcap writer, reading against the mcap reader.

Ours and the floor take turns in one run; every figure is a median.
"""

import statistics
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.messages.cdr import encode
from flexslew_lab.log.recording.bag_writer import CHUNK_SIZE, BagWriter
from flexslew_lab.metrics.from_bag import metrics_of
from flexslew_lab.report.report import write_report

TICKS = 10_000  # of a 100 s trial
ROUNDS = 5


def figures() -> dict[str, float]:
    """Return rates [messages/s], their ratios to the floors [-] and the time of a report [s]."""
    messages = list(_messages(TICKS))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        ours, bare, read, floor = [], [], [], []
        for k in range(ROUNDS):
            ours.append(_seconds(partial(_write, folder / f"ours{k}", messages)))
            bare.append(_seconds(partial(_write_bare, folder / f"bare{k}.mcap", messages)))
        for _ in range(ROUNDS):
            read.append(_seconds(lambda: metrics_of(folder / "ours0")))
            floor.append(_seconds(lambda: _iterate(folder / "ours0" / "ours0_0.mcap")))
        report = _seconds(lambda: write_report([folder / "ours0"], folder / "report.html"))
    n = len(messages)
    return {
        "log_write_messages_per_s": n / statistics.median(ours),
        "log_write_bare_mcap_messages_per_s": n / statistics.median(bare),
        "log_write_ratio_to_bare_mcap": _ratio(bare, ours),
        "log_metrics_messages_per_s": n / statistics.median(read),
        "log_mcap_reader_messages_per_s": n / statistics.median(floor),
        "log_metrics_ratio_to_mcap_reader": _ratio(floor, read),
        "log_report_s": report,
    }


def _seconds(action: Callable[[], Any]) -> float:
    start = time.perf_counter()
    action()
    return time.perf_counter() - start


def _ratio(floor: list[float], ours: list[float]) -> float:
    """Return the median of the ratios of neighbours, so a busy machine weighs on both."""
    return statistics.median(f / o for f, o in zip(floor, ours, strict=True))


def _messages(ticks: int) -> list[tuple[str, bytes, int]]:
    rng = np.random.default_rng(1)
    found: list[tuple[str, bytes, int]] = []
    for k in range(ticks):
        stamp = k * 10_000_000
        q, v, u = rng.normal(size=5), rng.normal(size=5), rng.normal(size=2)
        head = {"stamp": stamp}
        rows: dict[str, dict[str, Any]] = {
            "/clock": {"clock": stamp},
            "/truth": {
                "header": head, "tick": k, "position": q, "velocity": v, "applied_effort": u,
                "disturbance": np.zeros(2), "tip_deflection": q[2:4], "energy": 1.0,
            },
            "/measurement": {
                "header": head, "tick": k, "controller": "pd_feedforward",
                "joint_position": q[:2], "joint_velocity": v[:2], "tip_deflection": q[2:4],
                "root_curvature": q[2:4], "applied_effort": u,
            },
            "/effort_command": {
                "stamp": stamp, "tick": k, "controller": "pd_feedforward", "effort": u,
            },
        }  # fmt: skip
        found += [(t, encode(TOPICS[t].type, row), stamp) for t, row in rows.items()]
    return found


def _write(folder: Path, messages: list[tuple[str, bytes, int]]) -> None:
    types = {topic: TOPICS[topic].type for topic, _, _ in messages[:4]}
    writer = BagWriter(folder, {"trial": "name: bench\n"})
    write = writer.write
    for topic, data, stamp in messages:
        write(topic, types[topic], data, stamp)
    writer.close({})


def _write_bare(path: Path, messages: list[tuple[str, bytes, int]]) -> None:
    with path.open("wb") as file:
        writer: Any = Writer(file, chunk_size=CHUNK_SIZE, compression=CompressionType.ZSTD)
        writer.start("ros2", "bare")
        channels = {}
        for topic, _, _ in messages[:4]:
            schema = writer.register_schema(TOPICS[topic].type, "ros2msg", b"")
            channels[topic] = writer.register_channel(topic, "cdr", schema)
        for topic, data, stamp in messages:
            writer.add_message(channels[topic], stamp, data, stamp)
        writer.finish()


def _iterate(path: Path) -> int:
    with path.open("rb") as file:
        return sum(1 for _ in make_reader(file).iter_messages())


if __name__ == "__main__":
    for key, value in figures().items():
        print(f"{key:40s} {value:12.4g}")
