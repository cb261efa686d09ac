"""What was flown over ROS 2, with a hand on it, flies again in process to the last bit."""

import os
import signal
from threading import Timer

from flexslew_lab.operator_node import switch_controller
from flexslew_lab.resim import resim

from .flight import Flight, slew

CREW = ", output_feedback: {mode: tracking_a}"


def test_a_switch_typed_by_hand_flies_again_to_the_same_hash(tmp_path):
    def by_hand(pids):
        answers.append(switch_controller("output_feedback", 0.0, False, 1.0))

    answers = []
    flight = Flight(
        slew(duration=150.0, more=CREW, extra="display_rate: 0.0"), tmp_path, 1, by_hand
    )
    assert flight.outcome == (0, "")
    assert answers[0][0], answers
    again = resim(flight.bag)
    assert flight.events.count("switched") == 1
    assert again.replayed["switch_requested"] == 1
    assert again.first_difference is None
    assert again.hash == flight.metrics["trajectory_hash"]


def test_late_answers_and_a_fallback_fly_again_to_the_same_hash(tmp_path):
    def hold_up(pids):
        os.kill(pids["pd_feedforward"], signal.SIGSTOP)
        Timer(2.0, os.kill, (pids["pd_feedforward"], signal.SIGCONT)).start()  # and all is late

    trial = slew(duration=15.0, more=CREW, extra="fallback: [output_feedback]\ndisplay_rate: 0.0")
    flight = Flight(trial, tmp_path, 1, hold_up)
    assert "fallback" in flight.events
    again = resim(flight.bag)
    assert again.replayed["missed"] == flight.metrics["missed_ticks"] > 0
    assert again.first_difference is None
    assert again.hash == flight.metrics["trajectory_hash"]
