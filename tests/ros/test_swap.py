"""Every law flies over DDS as in process, also across a swap."""

from pathlib import Path

from flexslew_lab.run.run_trial import run_trial

from .flight import Flight, slew

OTHERS = ", output_feedback: {}, proportional_integral: {}, lqr: {}, collocated_pid: {}"
SWAPS = """
schedule:
  - {at: 1.5, switch: output_feedback}
  - {at: 3.0, switch: proportional_integral}
  - {at: 3.5, until: 5.0, disturbance: {base_yaw: 5.0}}
  - {at: 4.5, switch: lqr}
  - {at: 5.5, switch: collocated_pid}
"""


def test_five_laws_and_four_swaps_give_the_same_bits_over_dds(tmp_path: Path) -> None:
    trial = slew(duration=7.0, more=OTHERS, extra=SWAPS)
    alone = run_trial(trial, "test", tmp_path / "alone", in_process=True, report=False)
    flight = Flight(trial, tmp_path / "dds")
    assert flight.outcome == (0, "")
    metrics = flight.metrics
    assert metrics["trajectory_hash"] == alone.metrics["trajectory_hash"]
    assert (metrics["switches"], metrics["missed_ticks"]) == (4, 0)
    assert metrics["largest_effort_step"] < 1.5  # 1 % of the limit
