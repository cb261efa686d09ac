"""What a bench answers to an operator who switches and steps, whatever becomes of it."""

import os
import signal
from pathlib import Path
from typing import Any

import pytest
from flexslew_msgs.srv import ListControllers, Step, SwitchController
from std_srvs.srv import Trigger

from flexslew_lab.log.bag_reader import BagReader
from flexslew_plant.ros.messages import stamp

from .bystander import Bystander, beside
from .flight import LONG, Flight, slew

pytestmark = pytest.mark.ros


def switch(bench: Bystander, controller: str, **more: Any) -> Any:
    return bench.ask(SwitchController, "switch_controller", controller=controller, **more)


def one_more(bench: Bystander) -> int:
    """Return the tick to which a bench that rests, or soon will, flies one tick on."""
    replies: list[Any] = []

    def taken() -> bool:
        replies.append(bench.ask(Step, "step", ticks=1))
        return bool(replies[-1].ok)

    bench.until(taken)
    return int(replies[-1].tick)


def stepped(bench: Bystander) -> tuple[int, int]:
    """Return where two single steps end after a long one that a pause cut short."""
    assert bench.ask(Trigger, "pause").success
    assert bench.ask(Step, "step", ticks=100_000).ok
    bench.pass_by(5)
    assert bench.ask(Trigger, "pause").success
    return one_more(bench), one_more(bench)


def test_every_switch_is_answered_with_who_is_in_charge(tmp_path: Path) -> None:
    answers: dict[str, Any] = {}
    steps: list[int] = []

    def stepless(bench: Bystander) -> bool:
        """Return whether pd takes over from the brake without any step: now and then it can."""
        assert bench.ask(Trigger, "brake").success
        bench.pass_by(50)
        released = bench.ask(Trigger, "release_brake")
        assert released.success
        first = int(released.message.split("tick ")[1].split()[0])
        bench.until(lambda: bench.tick > first)  # who listens may be behind the bench
        answers["strict"] = switch(bench, "pd_feedforward", strict=True, max_effort_step=0.0)
        return bool(answers["strict"].ok)

    def operate(pids: dict[str, int], domain: int) -> None:
        with beside(domain) as bench:
            answers["same"] = switch(bench, "pd_feedforward")
            answers["late"] = switch(bench, "lqr", at=stamp(2.0 * LONG))
            answers["stranger"] = switch(bench, "nobody")
            bench.swap("lqr")
            bench.until(lambda: bench.ask(ListControllers, "list_controllers").active == "lqr")
            os.kill(pids["output_feedback"], signal.SIGSTOP)  # not known to be silent yet
            answers["mute"] = switch(bench, "output_feedback", timeout=20.0)
            os.kill(pids["output_feedback"], signal.SIGCONT)
            for step in (-1.0, float("nan")):
                answers[f"{step}"] = switch(bench, "lqr", strict=True, max_effort_step=step)
            bench.until(lambda: not stepless(bench))
            bench.swap("pd_feedforward")
            steps.extend(stepped(bench))
        raise KeyboardInterrupt

    # the brake gives way to the one, so the law may end at the same limit, and holds the other
    push = "schedule: [{at: 0.0, disturbance: {base_yaw: 20.0, hub_pitch: 2.0}}]"
    # a second and a half, in which the one in charge stays so: on a busy machine, too, and where
    # DDS holds its senders up for a second because of the one that was stopped
    push += "\nmax_missed: 300"
    trial = slew(LONG, 2.0, ", lqr: {}, output_feedback: {}", push)
    flight = Flight(trial, tmp_path, 1, operate)
    assert flight.outcome.exit_code == 130
    words = {
        "same": ("already in charge", "pd_feedforward"),
        "late": ("is too late", "pd_feedforward"),
        "stranger": ("unknown controller nobody", "pd_feedforward"),
        "mute": ("output_feedback never answered; lqr is in charge", "lqr"),
        "strict": ("its effort would step by", ""),
        "-1.0": ("max_effort_step: -1.0 is not allowed: 0 or more", "lqr"),
        "nan": ("max_effort_step: nan is not allowed: 0 or more", "lqr"),
    }
    for name, (said, active) in words.items():
        answer = answers[name]
        assert (answer.ok, answer.scheduled) == (False, False), name
        assert said in answer.message
        assert answer.active == active, name
    assert steps[1] == steps[0] + 1  # nothing was left of the long step
    kinds = [event.kind for event in BagReader(flight.bag).overview.events]
    assert {"fallback", "switch_refused"} <= {*kinds}
