"""What was flown over ROS 2, with a hand on it, flies again in process to the last bit."""

import shutil
from pathlib import Path
from typing import Any

import pytest
import rclpy
from flexslew_msgs.msg import Event
from flexslew_msgs.srv import (
    EndFault,
    InjectFault,
    ListControllers,
    Note,
    Operate,
    SetRate,
    Step,
    SwitchController,
    Tune,
)
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.checks.check import check_log
from flexslew_lab.replay.resim import resim
from flexslew_lab.run.processes import NodeProcess
from flexslew_plant.errors import BadInput
from flexslew_plant.graph.topics import EVENTS, TOPICS
from flexslew_plant.own_code import Trust
from flexslew_plant.ros.messages import stamp
from flexslew_plant.ros.offers import qos

from .bystander import beside, held
from .flight import LONG, Flight, slew

pytestmark = pytest.mark.ros

PATIENT = "display_rate: 0.0\nmax_missed: 1000"
OTHERS = ", output_feedback: {mode: tracking_a}"


def test_late_answers_and_a_fallback_fly_again_to_the_same_hash(tmp_path: Path) -> None:
    """The late answers come while the fallback flies."""

    def hold_up(pids: Any, domain: int) -> None:
        with beside(domain) as bench:
            kinds: list[str] = []
            profile = qos(TOPICS[EVENTS])
            bench.node.create_subscription(Event, EVENTS, lambda e: kinds.append(e.kind), profile)
            assert bench.ask(SetRate, "set_rate", rate_factor=0.0).ok
            with held(pids["pd_feedforward"]):
                bench.until(lambda: "fallback" in kinds)
            bench.pass_by(300)
        raise KeyboardInterrupt

    extra = "fallback: [output_feedback]\ndisplay_rate: 0.0"
    flight = Flight(slew(LONG, 1.0, OTHERS, extra, patience=1.0), tmp_path, 1, hold_up)
    assert "fallback" in flight.events, flight.log
    again = resim(flight.bag)
    assert again.replayed["missed"] == flight.metrics["missed_ticks"] > 0
    assert again.first_difference is None
    assert again.hash == flight.metrics["trajectory_hash"]


def ask(domain: int, *requests: Any) -> Any:
    """Return the bench's answers to requests typed one after another."""
    rclpy.init(domain_id=domain)
    node = rclpy.create_node("operator")
    answers: list[Any] = []
    try:
        for kind, name, values in requests:
            client = node.create_client(kind, name)
            assert client.wait_for_service(timeout_sec=20.0), name
            future = client.call_async(kind.Request(**values))
            rclpy.spin_until_future_complete(node, future, timeout_sec=20.0)
            answers.append(future.result())
        return answers
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def standing(domain: int) -> Any:
    """Return the status of every controller."""
    return ask(domain, (ListControllers, "list_controllers", {}))[0].controllers


def swap(name: Any, at: float = 0.0, **more: Any) -> tuple[Any, str, Any]:
    return SwitchController, "switch_controller", {"controller": name, "at": stamp(at), **more}


def fault(text: Any, at: float = 0.0, **more: Any) -> tuple[Any, str, Any]:
    return InjectFault, "inject_fault", {"fault": text, "at": stamp(at), "who": "ann", **more}


def test_a_session_worked_by_hand_flies_again_to_the_same_hash(tmp_path: Path) -> None:
    def by_hand(pids: Any, domain: int) -> None:
        answers.extend(
            ask(
                domain,
                swap("output_feedback", who="ann"),
                fault("", values=[Parameter("disturbance.base_yaw", value=3.0).to_parameter_msg()]),
                (Tune, "output_feedback/tune", {"settings": "{reaching_rate: 3.0}", "who": "bob"}),
                swap("pd_feedforward"),
                (Tune, "pd_feedforward/tune", {"settings": "{kp: [500.0], kd: [950.0]}"}),
                (Trigger, "pause", {}),
                (Note, "note", {"text": "paused to look", "who": "ann"}),
                (Step, "step", {"ticks": 10, "who": "ann"}),
                (Trigger, "reset", {}),
                (Operate, "operate", {"action": "start", "who": "bob"}),
                (SetRate, "set_rate", {"rate_factor": 5.0, "who": "bob"}),
                fault("{kind: command_lost, probability: 0.2}", 30.0),
                swap("output_feedback", 40.0, timeout=0.01),
                (Trigger, "brake", {}),
                (Trigger, "release_brake", {}),
                swap("pd_feedforward"),
                (EndFault, "end_fault", {"number": 0, "who": "ann"}),
                (SetRate, "set_rate", {"rate_factor": 0.0}),
            )
        )
        with beside(domain) as bench:
            bench.pass_by(1)
            bench.pass_by(300)
        raise KeyboardInterrupt

    answers: list[Any] = []
    trial = slew(LONG, 5.0, OTHERS, f"{PATIENT}\nallow_faults: true")
    flight = Flight(trial, tmp_path, 1, by_hand)
    done = [getattr(a, "ok", getattr(a, "success", False)) for a in answers]
    words = [answer.message for answer in answers]
    assert [k for k, ok in enumerate(done) if not ok] == [12], words
    assert answers[12].scheduled  # its time had not come; then the brake was latched
    events = BagReader(flight.bag).overview.events
    assert {event.epoch for event in events if event.source == "plant"} == {0, 1}
    told = {event.kind: event.data.get("who") for event in events}
    assert told["note"] == "ann"
    assert told["fault_ended"] == "ann"
    assert told["rate"] == "unnamed"
    assert "brake" not in told
    assert [e.source for e in events if e.kind == "tuned"] == ["output_feedback", "pd_feedforward"]
    again = resim(flight.bag)
    assert again.first_difference is None
    assert again.replayed == {
        "switch_requested": 4, "injected": 2, "fault_ended": 1, "brake_requested": 2, "tuned": 2,
        "retargeted": 0,
        "missed": flight.events.count("missed"),  # of both epochs
    }  # fmt: skip
    assert again.hash == again.recorded_hash == flight.metrics["trajectory_hash"]
    assert [finding for finding in check_log(flight.bag) if not finding.ok] == []


def guest(name: Any, law: Any, **values: Any) -> NodeProcess:
    """Return a controller that is not in the trial, with a law of the user's own."""
    return NodeProcess(
        name, "flexslew_control", "controller",
        {"law": law, "wait_for": ["recorder"], "exit_with_plant": True, **values},
    )  # fmt: skip


def test_guests_that_flew_in_the_trial_fly_again_or_it_says_what_is_missing(tmp_path: Path) -> None:
    def by_hand(pids: Any, domain: int) -> None:
        planned = ([bool(s.plan_hash) for s in standing(domain)] for _ in range(100))
        assert [True] * 3 in planned  # a newcomer may receive the plan late
        swaps = [swap("own", 2.0, timeout=0.01), swap("stiff", 4.0, timeout=0.01)]
        answers.extend(ask(domain, *swaps, (Trigger, "start", {})))

    answers: list[Any] = []
    file = tmp_path / "guest_law.py"
    shutil.copy(Path(__file__).parents[2] / "docs" / "examples" / "my_law.py", file)
    guests = [
        guest("own", f"{file}:MyLaw", kp=300.0, kd=800.0),
        guest("stiff", "pd_feedforward", kp=[600.0, 600.0], handover_time=0.5),
    ]
    trial = slew(8.0, 0.0, "", PATIENT)
    flight = Flight(trial, tmp_path / "run", extra=guests, begin=by_hand)
    assert flight.outcome == (0, "")
    assert all(answer.scheduled for answer in answers[:2]), answers
    blended = {
        state.tick: state.controller  # a repeated question is answered again
        for _, _, state in BagReader(flight.bag).decode_messages(("/controller_state",))
        if "handover" in state.term_names
    }
    assert [*blended.values()] == ["own"] * 100 + [
        "stiff"
    ] * 50  # 1 s if nothing is said, as documented
    own = f"{file}:MyLaw"
    again = resim(flight.bag, trust=Trust.of([own]))
    assert flight.events.count("switched") == 2
    assert again.first_difference is None
    assert again.hash == flight.metrics["trajectory_hash"]
    file.unlink()
    with pytest.raises(BadInput, match=r"controllers\.own: .*guest_law\.py") as missing:
        resim(flight.bag, trust=Trust.of([own]))
    assert "\n" not in str(missing.value)
