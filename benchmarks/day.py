"""A day on the bench: memory of recording and of reading, and the rate of reading the metrics.

Hours of simulated time: FLEXSLEW_BENCH_HOURS, default 24; period: FLEXSLEW_BENCH_PERIOD, default
0.01 s. Every step has a process of its own, so its peak is its own. A day takes some hours and what
it says of disk; shorter runs show the same. One step alone, a million seconds at 20 ticks a second:

    FLEXSLEW_BENCH_PERIOD=0.05 python benchmarks/day.py record BAG_FOLDER . 277.8
"""

import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.messages.cdr import encode
from flexslew_lab.log.recording.bag_observer import BagObserver
from flexslew_lab.log.recording.bag_writer import BagWriter
from flexslew_lab.run.in_process import run_bench
from flexslew_lab.trial.trial import (
    Trial,
    bench_settings,
    build_controllers,
    parse_trial,
    plan_of_trial,
    trial_text,
)
from flexslew_plant.bench.bench import Bench
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import Measurement

HOURS = "FLEXSLEW_BENCH_HOURS"
PERIOD = os.environ.get("FLEXSLEW_BENCH_PERIOD", "0.01")  # [s]
SAMPLE = 100.0  # recorded first, to tell the disk that is needed [simulated s]
SHARES = {"at_a_tenth_MB": 10, "at_three_tenths_MB": 30}  # of the run [%]
COPIES = 2.5  # of the bag that lie there at most: itself, its recovered copy, the report
STATUS_EVERY = 100  # ticks, as the nodes do
DISPLAY_EVERY = 2  # ticks
TRIAL = """
name: day
duration: {seconds}
period: {period}
sensors: {{joint_position: {{noise: 1.0e-5}}}}
plan:
  method: reference_only
  model: {{variant: complete, modes: 1}}
  goal: {{base_yaw: 0.5, hub_pitch: 0.2}}
  duration: 25.0
controllers: {{pd_feedforward: {{}}, output_feedback: {{mode: tracking_a}}}}
schedule:
  - {{at: 30.0, disturbance: {{base_yaw: {{sine: {{amplitude: 3.0, frequency: 0.05}}}}}}}}
  - {{at: 60.0, switch: output_feedback}}
"""


class AllTopics(BagObserver):
    """What the nodes say and an in-process run does not: clock, display topics, status again."""

    def __init__(self, writer: BagWriter) -> None:
        super().__init__(writer)
        self._status: list[dict[str, Any]] = []
        markers = [{"ns": "hub", "id": k, "points": [{"x": 1.0}] * 21} for k in range(4)]
        transforms = [{"child_frame_id": name} for name in ("base", "hub")]
        self._fixed = {  # always the same bytes: what they show does not matter here
            "/markers": encode(TOPICS["/markers"].type, {"markers": markers}),
            "/tf": encode(TOPICS["/tf"].type, {"transforms": transforms}),
        }

    def question(self, question: Measurement) -> None:
        """Write what goes out with a measurement."""
        super().question(question)
        self._put("/clock", {"clock": self._now})
        if question.tick % DISPLAY_EVERY == 0:
            header = {"stamp": self._now, "frame_id": ""}
            joints = {
                "header": header,
                "name": ["base_yaw", "hub_pitch"],
                "position": question.joint_position,
                "velocity": question.joint_velocity,
                "effort": question.applied_effort,
            }
            self._put("/joint_states", joints)
            self._put("/appendage_states", {"header": header})
            at = self._now.sec * 10**9 + self._now.nanosec
            for topic, data in self._fixed.items():
                self._writer.write(topic, TOPICS[topic].type, data, at)
        if question.tick % STATUS_EVERY == 0:
            for fields in self._status:
                super().status(fields | {"last_tick": question.tick})

    def status(self, fields: dict[str, Any]) -> Any:
        """Write the status of a controller, now and at intervals from now on."""
        self._status.append(fields)
        return super().status(fields)


def record(folder: Path, hours: float) -> dict[str, float]:
    """Fly and record; return the resident memory at these shares and at the end [MB]."""
    seconds = max(hours * 3600.0, SAMPLE)
    trial: Trial = parse_trial(TRIAL.format(seconds=seconds, period=PERIOD), "day")
    bench = Bench(bench_settings(trial))
    controllers = build_controllers(trial, "day")
    plan = plan_of_trial(trial)
    for controller in controllers.values():
        if plan is not None:
            controller.adopt(plan)
    probes = {
        (bench.last_tick or 0) // 1000 * share // 100 * 1000: name for name, share in SHARES.items()
    }
    seen: dict[str, float] = {}

    def look(tick: int) -> None:
        if tick in probes:
            seen[probes[tick]] = resident()
            _say(f"{probes[tick]}: {seen[probes[tick]]:.1f}")

    with BagWriter(folder, {"trial": trial_text(trial)}) as writer:
        observer = AllTopics(writer)
        observer.notify(trial, bench, plan, controllers)
        run_bench(bench, controllers, observer, look)
        seen["at_the_end_MB"] = resident()
        writer.close({"messages": str(writer.messages)})
    return seen | {"messages": writer.messages}


def metrics(bag: Path, scratch: Path) -> None:
    from flexslew_lab.metrics.from_bag import metrics_of

    metrics_of(bag)


def mcap_reader(bag: Path, scratch: Path) -> None:
    from mcap.reader import make_reader

    with next(bag.glob("*.mcap")).open("rb") as file:
        for _ in make_reader(file).iter_messages():
            pass


def log_check(bag: Path, scratch: Path) -> None:
    from flexslew_lab.log.checks.check import check_log

    wrong = [finding for finding in check_log(bag) if not finding.ok]
    if wrong:
        raise RuntimeError(f"the log is not sound: {wrong}")


def log_info(bag: Path, scratch: Path) -> None:
    from flexslew_lab.log.info import log_info

    log_info(bag)


def report(bag: Path, scratch: Path) -> None:
    from flexslew_lab.report.report import write_report

    write_report([bag], scratch / "report.html")


def recover(bag: Path, scratch: Path) -> None:
    from flexslew_lab.log.recover import recover

    recover(bag, scratch / "recovered")


def export(bag: Path, scratch: Path) -> None:
    from flexslew_lab.log.export import export_log

    export_log(bag, scratch / "tables")


def play(bag: Path, scratch: Path) -> None:
    """Jump to the middle and play a minute."""
    from flexslew_lab.replay.player import Player, PlaySettings

    player = Player(PlaySettings(bag=str(bag), rate=0.0))
    player.seek(player.last * 0.5e-9)
    player.step(player.time + 60.0)


def resim(bag: Path, scratch: Path) -> None:
    from flexslew_lab.replay.resim import resim

    if not resim(bag).identical:
        raise RuntimeError("the run again is another one")


STEPS: dict[str, Callable[[Path, Path], None]] = {
    step.__name__: step
    for step in (metrics, mcap_reader, log_check, log_info, report, recover, export, play, resim)
}


def figures() -> dict[str, float]:
    """Return for every step its peak and what it adds to its start [MB], and its time [s].

    day_metrics_ratio_to_mcap_reader: messages a second of reading the metrics over those of the
    mcap package's reader, both over the same file [-].
    """
    hours = float(os.environ.get(HOURS, "24"))
    found: dict[str, float] = {"day_hours": hours}
    with tempfile.TemporaryDirectory(prefix="flexslew_day_") as name:
        folder = Path(name)
        sample = _in_own_process("record", folder / "sample", folder, SAMPLE / 3600.0)
        size = _size(folder / "sample") * hours * 3600.0 / SAMPLE
        _say(
            f"{hours:g} h: the bag takes about {size / 1e9:.2g} GB, all of it {COPIES} times that "
            f"in {folder.parent}; recording takes about {sample['s'] * hours * 36 / 60:.0f} min"
        )
        free = shutil.disk_usage(folder).free
        if COPIES * size > free:
            raise BadInput(f"{folder.parent}: {free / 1e9:.3g} GB free; choose another with TMPDIR")
        bag = folder / "bag"
        for step in ("record", *STEPS):
            scratch = folder / "scratch"
            scratch.mkdir()
            done = _in_own_process(step, bag, scratch, hours)
            shutil.rmtree(scratch)
            _say(f"{step}: " + ", ".join(f"{key} {value:.4g}" for key, value in done.items()))
            found |= {f"day_{step}_{key}": value for key, value in done.items()}
        found["day_bag_GB"] = _size(bag) / 1e9
    messages = found["day_record_messages"]
    found["day_metrics_messages_per_s"] = messages / found["day_metrics_s"]
    found["day_mcap_reader_messages_per_s"] = messages / found["day_mcap_reader_s"]
    found["day_metrics_ratio_to_mcap_reader"] = found["day_mcap_reader_s"] / found["day_metrics_s"]
    return found


def resident() -> float:
    """Return the memory of this process that is in use now [MB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6


def _in_own_process(step: str, bag: Path, scratch: Path, hours: float) -> dict[str, float]:
    command = [sys.executable, __file__, step, str(bag), str(scratch), str(hours)]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    result: dict[str, float] = json.loads(done.stdout)
    return result


def _main(step: str, bag: Path, scratch: Path, hours: float) -> None:
    begun, started = resident(), time.perf_counter()
    seen: dict[str, float] = {}
    if step == "record":
        seen = record(bag, hours)
    else:
        STEPS[step](bag, scratch)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6
    took = time.perf_counter() - started
    print(json.dumps({"peak_MB": peak, "added_MB": peak - begun, "s": took, **seen}))


def _size(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.iterdir())


def _say(words: str) -> None:
    print(words, file=sys.stderr, flush=True)


if __name__ == "__main__":
    _main(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]), float(sys.argv[4]))
