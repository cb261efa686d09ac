"""The schema of metrics.json: every key with its unit and its meaning."""

from typing import NamedTuple


class Metric(NamedTuple):
    """What a key of metrics.json holds."""

    unit: str
    per_joint: bool  # an object by joint name; units are those of the joint where two are given
    meaning: str


# After a reset (a new epoch) only the last epoch counts.
METRICS: dict[str, Metric] = {
    "residual_tip_deflection": Metric(
        "m",
        False,
        "largest |tip deflection| of any appendage after the end of the manoeuvre",
    ),
    "residual_attitude_error": Metric(
        "rad or m",
        True,
        "largest |joint position - goal| after the end of the manoeuvre",
    ),
    "final_error": Metric("rad or m", True, "joint position - goal at the last tick"),
    "terminal_error_norm": Metric(
        "mixed SI",
        False,
        "norm of (joint errors, modal positions, all rates) at the end of the manoeuvre",
    ),
    "settling_time": Metric(
        "s",
        True,
        "from the start of the manoeuvre until the joint stays within 2 % of its commanded move "
        "around the goal; null: never",
    ),
    "overshoot": Metric(
        "-",
        True,
        "overshoot as a fraction of the commanded move, after the start; null: no move",
    ),
    "peak_tip_deflection": Metric("m", False, "largest |tip deflection| of any appendage"),
    "peak_effort": Metric("N m or N", True, "largest |applied effort|"),
    "rms_effort": Metric(
        "N m or N",
        True,
        "root mean square of the applied effort, over all ticks",
    ),
    "control_effort": Metric(
        "(N m)^2 s",
        False,
        "integral of the sum of squared efforts over the run",
    ),
    "saturated_time": Metric("s", False, "time with at least one drive at its limit"),
    "missed_ticks": Metric("-", False, "ticks without a valid answer in time"),
    "switches": Metric("-", False, "changes of the controller in charge that took effect"),
    "largest_effort_step": Metric(
        "N m or N",
        False,
        "largest step of any effort at a switch; null: no switch",
    ),
    "faults": Metric(
        "-",
        False,
        "faults that began, injected ones included; a fallback or the brake that takes over is one",
    ),
    "fallbacks": Metric("-", False, "times that a fallback or the brake took over"),
    "manoeuvre_start": Metric("s", False, "start of the last plan; 0 without a plan"),
    "manoeuvre_end": Metric("s", False, "end of the last plan; 0 without a plan"),
    "ticks": Metric("-", False, "ticks that the truth covers: last minus first"),
    "duration": Metric("s", False, "simulated time from the first to the last truth"),
    "wall_time": Metric(
        "s",
        False,
        "wall time of the run; null: not recorded",
    ),
    "trajectory_hash": Metric(
        "hex",
        False,
        "SHA-256 of tick (uint64) and state [q, v] (float64), little-endian, tick by tick",
    ),
    "missing_ticks": Metric("-", False, "ticks missing from the truth in the log"),
    "log_complete": Metric(
        "-",
        False,
        "whether the log was finished; false: it is cut, and the numbers are those up to the cut",
    ),
    "warnings": Metric(
        "-",
        False,
        "why these numbers may not be those of the run, in words: parts of the log that no "
        "checksum protects",
    ),
}

# more keys of a testbed whose appendages point somewhere; objects by appendage, actuator or wheel
POINTING_METRICS: dict[str, Metric] = {
    "pointing_error": Metric(
        "rad",
        False,
        "by appendage, x y z: largest |attitude error + its tip's turn| after the manoeuvre's end",
    ),
    "residual_tip_rotation": Metric(
        "rad", False, "by appendage, x y z: largest |turn of its tip| after the manoeuvre's end"
    ),
    "pointing_settled_at": Metric(
        "s",
        False,
        "by appendage: last time with any component above the pointing tolerance; null: never",
    ),
    "control_effort_by_actuator": Metric(
        "(N m)^2 s or N^2 s", False, "by actuator: integral of its squared effort"
    ),
    "peak_platform_attitude": Metric("rad", False, "x y z: largest |turn| from inertial axes"),
    "peak_platform_position": Metric("m", False, "x y z: largest |place| of the body origin"),
    "peak_tip_deflection": Metric("m", False, "by appendage: largest distance of its tip"),
    "peak_wheel_momentum": Metric(
        "N m s", False, "by wheel: largest momentum of its spin relative to the platform"
    ),
}
