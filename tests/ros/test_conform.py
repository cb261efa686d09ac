"""External controllers in the lock-step: ours keep its rules, and each broken rule is told."""

import json
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from flexslew_lab.cli.main import main

from .own_programs import build_in_c, needs_gcc, of_example

Examine = Callable[..., tuple[int, dict[str, str]]]


@pytest.fixture
def examine(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Examine:
    """Return a function that examines a command: the exit code and what is wrong, by rule."""

    def run(*command: str, patience: float = 120.0) -> tuple[int, dict[str, str]]:
        options = ["--json", "--patience", str(patience), "--", *command]
        monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)  # each run in a domain of its own
        monkeypatch.setattr(sys, "argv", ["flexslew", "conform", *options])
        with pytest.raises(SystemExit) as end:
            main()
        written = capfd.readouterr()
        assert written.out, written.err
        found: list[dict[str, Any]] = json.loads(written.out)
        rules = {each["rule"].partition(":")[0]: each["wrong"] for each in found}
        return int(end.value.code or 0), rules

    return run


BuildInC = Callable[..., str]


@pytest.fixture(name="build_in_c")
def _build_in_c(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> BuildInC:
    """Return a function that builds the example in C, with some words exchanged."""
    return partial(build_in_c, tmp_path, monkeypatch)


@pytest.mark.ros
@pytest.mark.parametrize("law", ["pd_feedforward", "output_feedback"])
def test_our_own_nodes_keep_every_rule(examine: Examine, law: str) -> None:
    node = [sys.executable, "-P", "-m", "flexslew_control.ros.controller_node"]
    code, wrong = examine(*node, "--ros-args", "-r", f"__node:={law}", "-p", f"law:={law}")
    assert wrong == dict.fromkeys(wrong, "")
    assert (code, len(wrong)) == (0, 12)


@pytest.mark.slow
def test_the_example_of_the_docs_keeps_every_rule(examine: Examine, tmp_path: Path) -> None:
    code, wrong = examine(*of_example(tmp_path))
    assert wrong == dict.fromkeys(wrong, "")
    assert (code, len(wrong)) == (0, 12)


@pytest.mark.ros
@needs_gcc
def test_the_example_in_c_is_built_as_the_page_shows_and_keeps_every_rule(
    examine: Examine, build_in_c: BuildInC
) -> None:
    code, wrong = examine(build_in_c())
    assert wrong == dict.fromkeys(wrong, "")
    assert (code, len(wrong)) == (0, 12)


@pytest.mark.ros
@needs_gcc
@pytest.mark.parametrize(("old", "new", "rule", "words"), [
    ("command.tick = m->tick", "command.tick = m->tick + 1", "first tick",
     "answer to tick 0 of epoch 0: it has tick 1 of epoch 0"),
    ("signal(SIGTERM, on_signal)", "signal(SIGTERM, SIG_IGN)", "start",
     "SIGTERM has not ended its process within 30 s; it was killed"),
])  # fmt: skip
def test_a_rule_that_a_program_in_c_breaks_is_reported_and_none_before_it(
    examine: Examine, build_in_c: BuildInC, old: str, new: str, rule: str, words: str
) -> None:
    code, wrong = examine(build_in_c((old, new)))
    assert code == 1
    assert next((rule, found) for rule, found in wrong.items() if found) == (rule, words)


# an integral: of what is asked again, too; or of each question once, but over a reset
INTEGRAL = ("effort=effort,", "effort=[each + self.integral for each in effort],")


def integrating(when: str) -> tuple[tuple[str, str], ...]:
    """Return what makes the example integrate where the condition holds; empty: always."""
    line = "        self.effort.publish("
    added = (
        f"        {when}self.integral += m.joint_position[0]\n        self.key = m.epoch, m.tick\n"
    )
    begin = "        self.limit: list[float] = []\n"
    return (line, added + line), (begin, begin + "        self.integral, self.key = 0.0, None\n")


@pytest.mark.ros
def test_each_broken_rule_is_told(examine: Examine, tmp_path: Path) -> None:
    dumb = ("self.create_timer(0.25, lambda: self.alive.publish(self.heartbeat))", "pass")
    deaf_to_epochs = ("epoch=m.epoch,\n", "epoch=0,\n")
    answers_for_all = ("m.controller != self.get_name() or not self.limit", "not self.limit")
    changes = dumb, deaf_to_epochs, answers_for_all, INTEGRAL, *integrating("")
    code, wrong = examine(*of_example(tmp_path, *changes))
    assert code == 1
    assert {rule for rule, words in wrong.items() if words} == {
        "heartbeat", "repeat", "swap", "pause", "reset", "backlog", "start",
    }  # fmt: skip
    assert wrong["repeat"].endswith("repeated: another effort than the first time")
    assert "no heartbeat of any_language" in wrong["heartbeat"]
    assert "name another controller" in wrong["swap"]
    assert "it has tick 0 of epoch 0" in wrong["reset"]


SEEN = "self.status.last_tick, self.status.epoch = m.tick, m.epoch"
NAMED = "m.controller != self.get_name()"


@pytest.mark.ros
def test_who_would_hold_up_a_bench_or_answers_nobody_s_questions_is_told(
    examine: Examine, tmp_path: Path
) -> None:
    silent = (SEEN, "pass")
    to_nobody = (NAMED, f"m.controller and {NAMED}")
    rare = ("create_timer(0.25", "create_timer(1.9")
    code, wrong = examine(*of_example(tmp_path, silent, to_nobody, rare))
    assert code == 1
    assert "has tick 0 of epoch 0; a bench waits for a controller that is" in wrong["lock-step"]
    assert "has tick 0 of epoch 0; a bench waits for a controller that is" in wrong["reset"]
    assert wrong["swap"] == "5 answers to questions that name no controller"
    assert wrong["heartbeat"].startswith("silent for 1.")


@pytest.mark.ros
def test_what_is_kept_over_a_reset_and_who_beats_as_another_are_told(
    examine: Examine, tmp_path: Path
) -> None:
    once = integrating("if self.key != (m.epoch, m.tick): ")
    other = ('role="controller"', 'role="law"')
    code, wrong = examine(*of_example(tmp_path, INTEGRAL, *once, other))
    assert code == 1
    assert {rule for rule, words in wrong.items() if words} == {
        "heartbeat", "pause", "reset", "backlog",
    }  # fmt: skip
    assert wrong["heartbeat"] == "its role on alive is 'law'; it must be 'controller'"
    assert wrong["reset"].startswith("tick 0 of the new epoch: another effort than at the start")


@pytest.mark.ros
def test_who_loses_questions_or_draws_no_number_is_told(examine: Examine, tmp_path: Path) -> None:
    """Of 200 questions that come at once, a subscription of depth 1 keeps the last."""
    shallow = ("measurement, LOOP)", "measurement, 1)")
    undrawn = ("instance = random.getrandbits(63)", "instance = 7")
    once = integrating("if self.key != (m.epoch, m.tick): ")
    begin = (SEEN, f"{SEEN}; self.integral *= m.tick > 0")
    busy = ("joints = zip", "time.sleep(0.001)\n        joints = zip")
    code, wrong = examine(*of_example(tmp_path, shallow, undrawn, INTEGRAL, *once, begin, busy))
    assert code == 1
    assert {rule for rule, words in wrong.items() if words} == {"backlog", "start"}
    assert wrong["backlog"].endswith("measurement is subscribed with a depth of 4000")
    assert wrong["start"].startswith("its instance on alive is 7 after a new start")


@pytest.mark.ros
def test_a_depth_of_one_is_found_without_an_estimator_too(examine: Examine, tmp_path: Path) -> None:
    """And a process that does not end, whose start lies before that of every namesake."""
    shallow = ("measurement, LOOP)", "measurement, 1)")
    oldest = ("since=time.time_ns()", "since=0")
    deaf = (
        "    rclpy.init()\n",
        "    rclpy.init()\n    signal.signal(signal.SIGTERM, signal.SIG_IGN)\n",
    )
    imported = ("import time\n", "import signal\nimport time\n")
    code, wrong = examine(*of_example(tmp_path, shallow, oldest, deaf, imported), patience=30.0)
    assert code == 1
    assert {rule for rule, words in wrong.items() if words} == {
        "heartbeat", "pause", "backlog", "start",
    }  # fmt: skip
    assert wrong["heartbeat"].startswith("its since on alive is 0, -")
    assert "measurement is subscribed with a depth of 4000" in wrong["backlog"]
    assert wrong["start"].startswith("SIGTERM has not ended its process within 30 s")


@pytest.mark.ros
def test_who_tells_another_number_in_its_status_is_told(examine: Examine, tmp_path: Path) -> None:
    code, wrong = examine(
        *of_example(tmp_path, ("            instance=instance,\n        )", "        )"))
    )
    assert code == 1
    assert "0 in its controller_status" in wrong["heartbeat"]


@pytest.mark.ros
def test_who_is_ready_only_in_charge_or_shares_a_number_with_others_is_told(
    examine: Examine, tmp_path: Path
) -> None:
    modest = (SEEN, f"{SEEN}; self.status.ready = not ({NAMED})")
    undrawn = ("instance = random.getrandbits(63)", "instance = 0")
    code, wrong = examine(*of_example(tmp_path, modest, undrawn))
    assert code == 1
    assert {rule for rule, words in wrong.items() if words} == {
        "heartbeat", "swap", "pause", "start",
    }  # fmt: skip
    assert wrong["heartbeat"].startswith("its instance on alive is 0")
    assert wrong["swap"].startswith(
        "not ready to take over from questions that name another controller"
    )


READY = 'self.status.ready, self.status.reason = True, ""'
LATER = "stamp=__import__('builtin_interfaces.msg').msg.Time(sec=7)"
TOLD = "        self.effort.publish("
HEARD = "self.on_measurement, LOOP"


@pytest.mark.ros
@pytest.mark.parametrize(("old", "new", "rule", "words"), [
    ("effort=effort", "effort=[*effort, 0.0]", "first tick", "3 efforts; the bench has 2"),
    ("effort=effort", "effort=[float('nan')] * 2", "first tick", "an effort is not finite"),
    ("stamp=m.header.stamp", LATER, "first tick", "its stamp is 7 s"),
    ("=self.heartbeat.instance", "=3", "first tick", "its instance is 3, on alive"),
    (TOLD, TOLD.replace("self", "for _ in '12': self"), "lock-step", "is answered twice"),
    (TOLD, TOLD + "bytes(44) or ", "first tick", "no EffortCommand in little-endian"),
    (READY, "pass", "status", "not ready: no testbed"),
    ('reason="no testbed yet"', "ready=True", "status", "ready before a testbed is announced"),
    ('status", LATCHED', 'status", LOOP', "status", "offers controller_status as volatile"),
    (HEARD, HEARD.replace("LOOP", "BEST_EFFORT"), "status", "as best effort"),
])  # fmt: skip
def test_an_answer_that_a_bench_would_reject_is_told(
    examine: Examine, tmp_path: Path, old: str, new: str, rule: str, words: str
) -> None:
    patience = 10.0 if rule == "status" else 120.0
    code, wrong = examine(*of_example(tmp_path, (old, new)), patience=patience)
    assert code == 1
    assert wrong[rule]
    assert words in wrong[rule]


@pytest.mark.ros
def test_a_command_that_ends_has_one_finding(examine: Examine) -> None:
    assert examine(sys.executable, "-c", "") == (
        1,
        {"status": "its process has ended (exit code 0)"},
    )


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (["--", "no_such_command"], "COMMAND: no_such_command: No such file or directory"),
        ([], "COMMAND: give the command that starts the controller, after --, or --serial"),
    ],
)
def test_a_command_that_does_not_start_is_refused_in_one_line(
    command: list[str],
    words: str,
    call: Callable[..., tuple[Any, str]],
) -> None:
    assert call("conform", *command) == (2, f"error: {words}")
