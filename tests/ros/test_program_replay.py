"""Programs of their own in place of the controllers of a log: `check` and `resim` with --with."""

import json
import os
import select
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from threading import Event, Thread
from typing import Any

import pytest
from flexslew_msgs.action import PlanSlew
from flexslew_msgs.srv import Operate, SetRate, Step
from std_srvs.srv import Trigger

from flexslew_lab.cli.main import main
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.metrics.from_bag import metrics_of
from flexslew_lab.replay.resim import resim
from flexslew_lab.run.processes import NodeProcess
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import parse_trial, trial_text
from flexslew_plant.errors import BadInput

from .bystander import beside
from .flight import Flight, slew
from .one_by_one import PLANT, Bench, standing
from .own_programs import EXAMPLE, build_in_c, needs_gcc, of_example
from .test_law_of_plans import asked, paused_at
from .test_resim import ask, swap
from .test_resim import standing as bench_of

EXPORTED = [sys.executable, str(EXAMPLE.with_name("exported_c.py"))]
NODE = [sys.executable, "-P", "-m", "flexslew_control.ros.controller_node"]
SAME_LAW = """
name: disturbed
duration: 2.0
plan: null
controllers: {pd_feedforward: {kp: [400.0, 400.0], kd: [1500.0, 1500.0]}}
schedule:
  - {at: 0.5, until: 1.0, disturbance: {base_yaw: 50.0}}
"""
PLANNED = """
name: planned
duration: 6.0
plan:
  method: reference_only
  model: {variant: complete, modes: 1}
  goal: {base_yaw: 0.1, hub_pitch: 0.05}
  duration: 5.0
controllers: {pd_feedforward: {kp: [460.0, 460.0]}, output_feedback: {}}
schedule: [{at: 1.5, switch: output_feedback}, {at: 3.0, switch: pd_feedforward}]
"""
Command = Callable[..., tuple[int, dict[str, Any], str]]


def flown(text: str, folder: Path) -> Path:
    run_trial(parse_trial(text, "test"), "test", folder, in_process=True, report=False)
    return folder


@pytest.fixture(scope="module")
def same_law(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a run of the law that the example has."""
    return flown(SAME_LAW, tmp_path_factory.mktemp("same_law") / "run")


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a run with a plan, two laws and two switches."""
    return flown(PLANNED, tmp_path_factory.mktemp("planned") / "run")


@pytest.fixture
def typed(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, str, str]]:
    """Return a function that runs a command: exit code, and what it and its program print."""

    def run(*words: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["flexslew", *words])
        with pytest.raises(SystemExit) as end:
            main()
        written = capfd.readouterr()
        return int(end.value.code or 0), written.out, written.err

    return run


@pytest.fixture
def replay(typed: Callable[..., tuple[int, str, str]]) -> Command:
    """Return a function that runs a replay: exit code, result, and errors."""

    def run(*words: str) -> tuple[int, dict[str, Any], str]:
        code, out, err = typed(words[0], "--json", "--patience", "120", *words[1:])
        return code, json.loads(out) if out else {}, err

    return run


def example(folder: Path, *changes: tuple[str, str]) -> str:
    """Return the command of the example with some words exchanged."""
    return shlex.join(of_example(folder, *changes))


def test_the_example_gives_the_answers_of_the_same_law_to_the_last_bit(
    replay: Command, same_law: Path, tmp_path: Path
) -> None:
    code, result, _ = replay("check", str(same_law), "--with", example(tmp_path))
    assert (code, result["ok"], result["ticks"]) == (0, True, 200)
    assert [row["field"] for row in result["rows"]] == [
        "stamp", "effort[base_yaw]", "effort[hub_pitch]",
    ]  # fmt: skip
    assert all(row["compared"] == 200 and row["largest"] == 0.0 for row in result["rows"])


@pytest.mark.ros
def test_a_gain_off_by_a_hundredth_is_found_at_the_first_tick_with_an_error(
    replay: Command, same_law: Path, tmp_path: Path
) -> None:
    """The disturbance acts from tick 50 on, so that the joints move from tick 51 on."""
    command = example(tmp_path, ("-STIFFNESS", "-1.01 * STIFFNESS"))
    code, result, _ = replay("check", str(same_law), "--with", command)
    first = result["first_divergence"]
    assert (code, first["tick"], first["field"]) == (1, 51, "effort[base_yaw]")
    stiffness_part = 100.0 * (first["ours"] - first["recorded"])
    assert 0.0 < stiffness_part / first["recorded"] < 1.0
    largest = next(r["largest"] for r in result["rows"] if r["field"] == "effort[base_yaw]")
    peak = largest / next(r["relative"] for r in result["rows"] if r["largest"])
    for option, allowed in (("--tolerance", largest / peak), ("--absolute", largest)):
        for factor, expected in ((1.01, 0), (0.99, 1)):
            words = option, repr(factor * allowed), "--with", command
            assert replay("check", str(same_law), *words)[0] == expected


def test_resim_flies_the_same_law_as_a_program_to_the_same_hash(
    replay: Command, same_law: Path, tmp_path: Path
) -> None:
    code, result, _ = replay("resim", str(same_law), "--with", example(tmp_path))
    assert (code, result["identical"], result["ticks"]) == (0, True, 201)


@pytest.mark.ros
@pytest.mark.parametrize("law", ["pd_feedforward", "output_feedback"])
def test_a_node_of_ours_follows_the_plans_and_handovers_of_the_log(
    replay: Command, planned: Path, law: str
) -> None:
    """Under another name than that in the log, so that its own name is another controller's."""
    other = {"pd_feedforward": "output_feedback", "output_feedback": "pd_feedforward"}[law]
    words = [*NODE, "--ros-args", "-r", f"__node:={other}", "-p", f"law:={law}"]
    gains = ["-p", "kp:=[460.0, 460.0]"] if law == "pd_feedforward" else []
    command = ["--with", "--", *words, *gains]
    code, result, _ = replay("check", str(planned), law, *command)
    assert (code, result["ok"]) == (0, True)
    assert result["ticks"] == {"pd_feedforward": 450, "output_feedback": 150}[law]
    code, result, _ = replay("resim", str(planned), "--controller", law, *command)
    assert (code, result["identical"]) == (0, True)


@pytest.mark.ros
@needs_gcc
def test_the_example_in_c_gives_the_answers_of_the_same_law(
    replay: Command, same_law: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    command = "--with", build_in_c(tmp_path, monkeypatch)
    code, result, _ = replay("check", str(same_law), *command, "--tolerance", "1e-15")
    assert (code, result["ticks"]) == (0, 200)
    code, result, _ = replay("resim", str(same_law), *command, "--elsewhere")
    assert (code, result["ticks"]) == (0, 201)


@needs_gcc
@pytest.mark.parametrize(("law", "tolerance"), [
    ("pd_feedforward", "0"), pytest.param("output_feedback", "1e-12", marks=pytest.mark.ros),
])  # fmt: skip
def test_exported_c_code_gives_the_answers_of_its_law(
    typed: Callable[..., tuple[int, str, str]], replay: Command, planned: Path, tmp_path: Path,
    law: str, tolerance: str,
) -> None:  # fmt: skip
    (tmp_path / "planned.yaml").write_text(PLANNED)
    folder, trial = tmp_path / "c", str(tmp_path / "planned.yaml")
    typed("export", trial, "--controller", law, "--c", str(folder), "--no-check")
    command = *EXPORTED, str(folder / f"planned_{law}.c")
    options = "--tolerance", tolerance, "--with", "--", *command
    code, result, errors = replay("check", str(planned), law, *options)
    assert (code, result["only_recorded"], result["only_ours"]) == (0, 0, 0), errors


@pytest.mark.ros
@needs_gcc
def test_exported_c_code_keeps_every_rule_of_the_lock_step(
    typed: Callable[..., tuple[int, str, str]], tmp_path: Path
) -> None:
    typed("export", "m1", "--c", str(tmp_path), "--no-check")
    command = *EXPORTED, str(tmp_path / "m1_pd_feedforward.c")
    code, out, _ = typed("conform", "--json", "--patience", "120", "--", *command)
    assert (code, [rule["wrong"] for rule in json.loads(out)]) == (0, [""] * 12)


def flight_of(command: list[str], name: str, at: float | None, folder: Path) -> Flight:
    """Fly two seconds over ROS with a program, from the time `at` on; None: from the start on."""
    answers, programs = list[Any](), list[subprocess.Popen[bytes]]()

    def begin(pids: Any, domain: int) -> None:
        environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
        programs.append(subprocess.Popen(command, env=environment))
        there = (
            one.ready for _ in range(100) for one in bench_of(domain) if one.controller == name
        )
        assert any(there)
        switches = [] if at is None else [swap(name, at, timeout=0.01)]
        answers.extend(ask(domain, *switches, (Trigger, "start", {})))

    def change(node: NodeProcess) -> NodeProcess:
        if at is None and node.name == "plant":
            node.parameters["bench"]["active"] = name
        return node

    def leave() -> None:  # a recorder waits for programs that are still there
        log = folder / "nodes.log"
        while not ended.wait(0.1) and "ticks in" not in (log.read_text() if log.exists() else ""):
            pass
        for program in programs:
            program.terminate()

    ended = Event()
    leaving = Thread(target=leave)
    leaving.start()
    try:
        flight = Flight(slew(2.0), folder, begin=begin, change=change)
    finally:
        ended.set()
        leaving.join()
        for program in programs:
            program.wait(60.0)
    assert flight.outcome == (0, ""), flight.log
    assert at is None or answers[0].scheduled, answers[0].message
    return flight


def test_a_flight_whose_controller_was_a_program_flies_again_with_it(
    replay: Command, tmp_path: Path
) -> None:
    command = of_example(tmp_path)
    flight = flight_of(command, "any_language", 1.0, tmp_path / "run")
    with pytest.raises(BadInput, match="was a program of its own by --with COMMAND"):
        resim(flight.bag)
    code, result, _ = replay("resim", str(flight.bag), "--with", "--", *command)
    assert (code, result["identical"]) == (0, True)
    assert result["hash"] == flight.metrics["trajectory_hash"]
    code, result, _ = replay("check", str(flight.bag), "--with", "--", *command)
    assert (code, result["controller"], result["ticks"]) == (0, "any_language", 100)


@pytest.mark.ros
@needs_gcc
def test_a_log_with_a_reset_is_replayed_by_a_node_of_ours_and_by_exported_c_code(
    typed: Callable[..., tuple[int, str, str]], replay: Command, tmp_path: Path
) -> None:
    def begin(pids: Any, domain: int) -> None:
        start = Operate, "operate", {"action": "start", "who": "ann"}
        steps = Step, "step", {"ticks": 40, "who": "ann"}
        ask(domain, start, (Trigger, "pause", {}), steps, (Trigger, "reset", {}), start)

    trial = slew(2.0, 1.0)
    flight = Flight(trial, tmp_path / "run", begin=begin)
    assert flight.outcome == (0, ""), flight.log
    assert "reset" in flight.events
    (tmp_path / "short.yaml").write_text(trial_text(trial))
    typed("export", str(tmp_path / "short.yaml"), "--c", str(tmp_path), "--no-check")
    gains = ["-p", "kp:=[460.0, 460.0]", "-p", "kd:=[920.0, 920.0]"]
    for command in (
        [*NODE, "--ros-args", "-r", "__node:=pd_feedforward", *gains],
        [*EXPORTED, str(tmp_path / "short_pd_feedforward.c")],
    ):
        code, result, errors = replay("check", str(flight.bag), "--with", "--", *command)
        assert code == 0, errors
        assert result["ticks"] > 200  # of both epochs
        code, result, errors = replay("resim", str(flight.bag), "--with", "--", *command)
        assert (code, result.get("identical")) == (0, True), errors


@pytest.mark.ros
def test_a_plan_that_came_in_flight_reaches_the_program_before_its_start(
    replay: Command, tmp_path: Path
) -> None:
    def operate(pids: dict[str, int], domain: int) -> None:
        with beside(domain) as bench:
            start = 0.01 * max(paused_at(bench) + 50, 550)  # after the first plan
            request = "{method: reference_only, model: {modes: 1}, goal: {base_yaw: 0.3}, "
            future = asked(bench, f"{request}duration: 5.0, start: {start:.2f}}}")
            bench.until(future.done)
            assert future.result().result.error_code == PlanSlew.Result.DONE
            assert bench.ask(SetRate, "set_rate", rate_factor=0.0).ok
            assert bench.ask(Trigger, "start").success

    flight = Flight(slew(12.0, 2.0), tmp_path / "run", 100, operate)
    assert flight.outcome == (0, ""), flight.log
    assert len(BagReader(flight.bag).overview.plans) == 2
    gains = ["-p", "kp:=[460.0, 460.0]", "-p", "kd:=[920.0, 920.0]"]
    command = [*NODE, "--ros-args", "-r", "__node:=port", "-p", "law:=pd_feedforward", *gains]
    code, result, errors = replay("check", str(flight.bag), "--with", "--", *command)
    assert (code, result.get("ticks")) == (0, 1200), errors
    code, result, errors = replay("resim", str(flight.bag), "--with", "--", *command)
    assert (code, result.get("identical")) == (0, True), errors


@pytest.mark.ros
@needs_gcc
def test_exported_c_code_flies_over_ros_as_its_law_does_in_process(
    typed: Callable[..., tuple[int, str, str]], tmp_path: Path
) -> None:
    trial = slew(2.0)
    run_trial(trial, "test", tmp_path / "law", in_process=True, report=False)
    (tmp_path / "short.yaml").write_text(trial_text(trial))
    typed("export", str(tmp_path / "short.yaml"), "--c", str(tmp_path), "--no-check")
    command = [*EXPORTED, str(tmp_path / "short_pd_feedforward.c")]
    flight = flight_of(command, "short_pd_feedforward", None, tmp_path / "run")
    states = flight.metrics["trajectory_hash"], flight.metrics["missed_ticks"]
    assert states == (metrics_of(tmp_path / "law" / "bag")["trajectory_hash"], 0)
    answers = BagReader(flight.bag).decode_messages(("/effort_command",))
    assert {answer.controller for _, _, answer in answers} == {"short_pd_feedforward"}


EFFORT = "        self.effort.publish("
LATE = "m.tick == 60"
GARBAGE = f"{EFFORT}bytes(44) if {LATE} else "
FAULTS = [
    (EFFORT, f"        if {LATE}: raise SystemExit(7)\n{EFFORT}",
     "its process has ended (exit code 7) at tick 60"),
    ("tick=m.tick", f"tick=m.tick + 3 * ({LATE})",
     "answer to tick 60 of epoch 0: it has tick 63 of epoch 0"),
    ("effort=effort", f"effort=effort[:1] if {LATE} else effort",
     "answer to tick 60 of epoch 0: 1 efforts; the bench has 2 actuators"),
    (EFFORT, GARBAGE, "a bench cannot read its answer: 44 bytes are no EffortCommand"),
]  # fmt: skip


@pytest.mark.ros
@pytest.mark.parametrize(("old", "new", "words"), FAULTS)
@pytest.mark.parametrize("command", ["check", "resim"])
def test_a_program_that_fails_in_flight_is_refused_in_one_line(
    replay: Command, same_law: Path, tmp_path: Path, command: str, old: str, new: str, words: str
) -> None:
    code, result, errors = replay(command, str(same_law), "--with", example(tmp_path, (old, new)))
    assert (code, result) == (2, {})
    error = errors.splitlines()[-1]
    assert error.startswith(f"error: {sys.executable} ")
    assert words in error


@pytest.mark.ros
def test_a_program_that_is_no_longer_ready_diverges_with_its_reason(
    replay: Command, same_law: Path, tmp_path: Path
) -> None:
    line = "        if m.controller != self.get_name() or not self.limit:\n"
    unready = "self.status.ready, self.status.reason = False, 'worn out'"
    lines = f"        if {LATE}: {unready}; self.told.publish(self.status)\n"
    changes = (line, lines + line), ("or not self.limit:", "or not self.status.ready:")
    code, result, _ = replay("check", str(same_law), "--with", example(tmp_path, *changes))
    first = result["first_divergence"]
    assert (code, result["ticks"], result["only_recorded"]) == (1, 60, 140)
    assert (first["tick"], first["ours"]) == (60, "no answer: not ready: worn out")


@pytest.mark.ros
def test_the_children_of_a_script_end_with_it(
    replay: Command, same_law: Path, tmp_path: Path
) -> None:
    """The child holds a pipe, which is at its end as soon as the child has ended."""
    pipe, child = tmp_path / "pipe", example(tmp_path)
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        script = f"{child} 3>{pipe}; true"
        code, _, _ = replay("check", str(same_law), "--with", "--", "sh", "-c", script)
        assert code == 0
        assert select.select([reader], [], [], 60.0)[0]
        assert os.read(reader, 1) == b""
    finally:
        os.close(reader)


@pytest.mark.ros
def test_a_program_that_hangs_is_refused_after_the_patience(
    typed: Callable[..., tuple[int, str, str]], same_law: Path, tmp_path: Path
) -> None:
    command = example(tmp_path, (EFFORT, f"        if {LATE}: time.sleep(1000)\n{EFFORT}"))
    code, _, errors = typed("check", str(same_law), "--patience", "5", "--with", command)
    assert code == 2
    assert errors.strip().endswith("controller.py: no answer to tick 60 within 5 s")


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (("check", "--with", "no_such_program"), "COMMAND: no_such_program: No such file"),
        (("resim", "--with", "'"), '--with: "\'" is not allowed: No closing quotation'),
        (("check", "--with", "--"), "--with: '' is not allowed: give the command"),
        (("check", "nobody", "--with", "true"), "no controller nobody; it has pd_feedforward"),
        (("resim", "--controller", "x", "--with", "true"), "no controller x; it has"),
        (
            ("resim", "--controller", "x"),
            "--controller: is the controller that --with COMMAND replaces",
        ),
        (("check", "--law", "lqr", "--with", "true"), "--with: --law and --set change a law"),
    ],
)
def test_options_that_do_not_fit_are_refused_in_one_line(
    call: Callable[..., tuple[Any, str]], same_law: Path, words: tuple[str, ...], error: str
) -> None:
    code, printed = call(words[0], str(same_law), *words[1:])
    assert code == 2
    assert len(printed.splitlines()) == 1
    assert error in printed


def test_a_damaged_bag_is_refused_before_the_program_is_started(
    call: Callable[..., tuple[Any, str]], same_law: Path, tmp_path: Path
) -> None:
    (file,) = (same_law / "bag").glob("*.mcap")
    (tmp_path / "cut.mcap").write_bytes(file.read_bytes()[:200])
    started = tmp_path / "started"
    for command in ("check", "resim"):
        code, printed = call(command, str(tmp_path / "cut.mcap"), "--with", f"touch {started}")
        assert code == 2
        assert "cut.mcap" in printed
    assert not started.exists()


class _Standing(Bench):
    """A bench whose nodes are started one by one, with a program as its active controller."""

    def __init__(self, folder: Path, domain: int) -> None:
        super().__init__(folder, domain)
        self.start("recorder", "flexslew_lab.ros.recorder_node", folder=str(folder / "bag"),
                   exit_with_plant="true")  # fmt: skip
        self.start("any_language", "tests.ros.namesake_node")
        bench = {"bench.active": "any_language", "bench.duration": "1.0", "rate_factor": "0.0"}
        self.start("plant", PLANT, wait_for="[recorder]", exit_when_done="true", **bench)
        self.until(lambda: not self.runs("plant"))
        self.end("recorder")


@pytest.fixture
def standing_bag(tmp_path: Path) -> Path:
    with standing(_Standing, tmp_path):
        pass
    return tmp_path / "bag"


@pytest.mark.ros
def test_a_bench_that_only_a_program_flew_flies_again_with_it(
    replay: Command, standing_bag: Path, tmp_path: Path
) -> None:
    assert list(BagReader(standing_bag).overview.statuses) == ["any_language"]
    for command in ("check", "resim"):
        code, _, errors = replay(command, str(standing_bag), "--with", example(tmp_path))
        assert code == 0, errors
