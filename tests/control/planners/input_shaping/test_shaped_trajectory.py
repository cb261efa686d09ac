"""A trajectory of others, shaped: the convolution by hand, the choice of a shaper, its files."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.spatial.transform import Rotation
from tests.plants import plant
from tests.representatives import representatives

from flexslew_control.plan import Plan
from flexslew_control.planners import make_plan, plan_settings
from flexslew_control.planners.input_shaping.shaped_modes import ShapedMode
from flexslew_control.planners.input_shaping.shaper_choice import ranking, reason, worst_residual
from flexslew_control.planners.input_shaping.shapers import make_shaper
from flexslew_lab.trial.trial import trial_of_values
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import read_testbed

PERIOD, W = 0.01, 3.0
SHAPERS = ("zv", "mzv", "zvd", "zvdd", "ei", "ei_two_hump", "ei_three_hump", "um_zv")
POINTS = [
    {"at": 0.0, "position": {"base_yaw": 0.0}, "velocity": {"base_yaw": 0.0}},
    {"at": 2.0, "position": {"base_yaw": 0.5}, "velocity": {"base_yaw": 0.0}},
]


def planned(**values: Any) -> Plan:
    section = plan_settings({"method": "input_shaping", **values}, "trial.yaml")
    return make_plan(section, plant(PERIOD, (150.0, 150.0)))


def cubic(t: Any) -> Any:
    """Return the motion of POINTS at times t."""
    s = np.clip(t / 2.0, 0.0, 1.0)
    return 0.5 * (3.0 * s**2 - 2.0 * s**3), 0.25 * (6.0 * s - 6.0 * s**2)


@pytest.mark.parametrize(
    ("name", "damping"),
    representatives(
        [(name, damping) for name in SHAPERS for damping in (0.0, 0.2, 0.7)],
        *((name, 0.2) for name in SHAPERS),
    ),
)
def test_it_is_the_convolution_by_hand(name: Any, damping: float) -> None:
    plan = planned(
        trajectory=POINTS, shaper=name, frequencies=[W, 7.1], damping=damping, negative=True
    )
    one, other = (make_shaper(name, w, damping, negative=True) for w in (W, 7.1))
    t = PERIOD * np.arange(plan.ticks + 1)
    position, velocity = np.zeros_like(t), np.zeros_like(t)
    for first, a in zip(one.times, one.amplitudes, strict=True):
        for second, b in zip(other.times, other.amplitudes, strict=True):
            q, v = cubic(t - first - second)
            position, velocity = position + a * b * q, velocity + a * b * v
    assert abs(plan.position[:, 0] - position).max() < 1e-9
    assert abs(plan.velocity[:, 0] - velocity).max() < 1e-9
    assert plan.position[-1].tolist() == pytest.approx([0.5, 0.0], abs=1e-12)
    assert not plan.position[:, 1].any()
    assert plan.summary["shaper_delay"] == pytest.approx(one.duration + other.duration)


def test_efforts_are_convolved_as_their_mean_over_each_tick() -> None:
    efforts = (40.0, 10.0)
    points = [
        {**point, "effort": {"base_yaw": u}} for point, u in zip(POINTS, efforts, strict=True)
    ]
    plan = planned(trajectory=points, shaper="zvd", frequencies=[W])
    shaper = make_shaper("zvd", W)

    def effort(t: float) -> float:
        values = [
            a * (40.0 - 15.0 * (t - at)) * (0.0 <= t - at <= 2.0)
            for at, a in zip(shaper.times, shaper.amplitudes, strict=True)
        ]
        return float(sum(values))

    jumps = [*shaper.times, *(shaper.times + 2.0)]
    for k in (0, 50, 104, 105, 150, 200, 209, 210, 304, 305, 409, plan.ticks - 1):
        begin, end = k * PERIOD, (k + 1) * PERIOD
        inside = [at for at in jumps if begin < at < end]
        mean = quad(effort, begin, end, points=inside or None, epsabs=1e-13)[0] / PERIOD
        assert plan.effort[k, 0] == pytest.approx(mean, abs=1e-9), k


def test_an_attitude_is_shaped_as_its_rotation_vector() -> None:
    body = {"mass": 9.0, "inertia": {"xx": 1.0, "yy": 1.0, "zz": 1.0}}
    craft = read_testbed({"kind": "spacecraft", "platform": body}, "here")
    end = {"roll": 0.4, "pitch": -0.3, "yaw": 0.2}
    rest = dict.fromkeys(end, 0.0)
    points = [{"at": t, "position": q, "velocity": rest} for t, q in ((0.0, rest), (2.0, end))]
    here = plant(PERIOD, tuple(craft.effort_limit), craft)
    section = plan_settings(
        {"method": "input_shaping", "trajectory": points, "frequencies": [W]}, "trial.yaml"
    )
    plan = make_plan(section, here)
    t = PERIOD * np.arange(plan.ticks + 1)
    path = 0.5 * (cubic(t)[0] + cubic(t - np.pi / W)[0]) / 0.5
    assert abs(plan.position - np.outer(path, [*end.values()])).max() < 1e-9
    turns = Rotation.from_rotvec(plan.position.copy())
    rates = (turns[:-1].inv() * turns[1:]).as_rotvec() / PERIOD
    middle = 0.5 * (plan.velocity[:-1] + plan.velocity[1:])
    # second order, and a part of a tick where the acceleration jumps by 0.4 rad/s^2
    assert abs(rates - middle).max() < 0.4 * PERIOD / 8.0


def left_after(w: float, zeta: float, times: Any, amplitudes: Any) -> float:
    """Return the amplitude that a mode keeps after impulses, by its motion, relative to one."""
    damped, end = w * np.sqrt(1.0 - zeta**2), times[-1]
    decays = amplitudes * np.exp(-zeta * w * (end - times))
    motion = decays @ np.exp(1j * damped * (end - times))
    return float(abs(motion))


@pytest.mark.parametrize("width", [0.01, 0.1, 0.25, 0.45])
def test_auto_takes_the_shortest_that_covers_the_intervals(width: float) -> None:
    modes = [
        ShapedMode(W, 0.01, (W * (1 - width), W * (1 + width)), (0.0, 0.02)),
        ShapedMode(11.0, 0.01, (10.8, 11.2), (0.01, 0.01)),
    ]
    candidates = ranking(modes, 0.05)
    best = candidates[0]
    assert best.residual <= 0.05 * (1 + 1e-9)
    shorter = [one for one in candidates if one.delay < best.delay]
    assert all(one.residual > 0.05 for one in shorter)
    rng = np.random.default_rng(3)
    for _ in range(200):
        mode = modes[rng.integers(2)]
        w, zeta = rng.uniform(*mode.frequencies), rng.uniform(*mode.dampings)
        assert left_after(w, zeta, best.shaper.times, best.shaper.amplitudes) < 0.0501
    assert best.name in reason(candidates, 0.05)
    assert "shortest delay" in reason(candidates, 0.05)


def test_where_no_shaper_covers_the_interval_the_least_residual_is_taken_and_said() -> None:
    modes = [ShapedMode(W, 0.0, (0.2 * W, 1.8 * W), (0.0, 0.0))]
    candidates = ranking(modes, 0.05)
    assert candidates[0].residual == min(one.residual for one in candidates) > 0.05
    assert "no shaper stays below 5 %" in reason(candidates, 0.05)
    assert worst_residual(candidates[0].shaper, modes) == candidates[0].residual


def test_the_plan_states_what_was_chosen_and_why() -> None:
    interval = {"value": 3.0, "low": 2.8, "high": 3.2}
    plan = planned(
        trajectory=POINTS, shaper="auto", modes=[{"frequency": interval, "damping_ratio": 0.01}]
    )
    summary = plan.summary
    assert summary["shaper"] in summary["shaper_choice"]
    assert summary["shaper_ranking"][0]["shaper"] == summary["shaper"]
    assert {*summary["shaper_ranking"][0]} == {"shaper", "delay", "smoothing", "residual"}
    assert summary["shaper_residual"] <= 0.05
    slew = planned(shaper="auto", modes=[{"frequency": interval}], duration=40.0)
    assert slew.summary["shaper"] == summary["shaper"]


NOTHING = "accelerations: [], effort: []"
MESSAGE = f"""
header: {{stamp: {{sec: 0, nanosec: 0}}, frame_id: ''}}
joint_names: [base_yaw]
points:
- {{positions: [0.0], velocities: [0.0], {NOTHING}, time_from_start: {{sec: 0, nanosec: 0}}}}
- {{positions: [0.5], velocities: [0.0], {NOTHING}, time_from_start: {{sec: 2, nanosec: 0}}}}
"""
IDENTIFIED = """
modes:
- frequency: {value: 4.0, low: 3.8, high: 4.2}
  damping_ratio: {value: 0.01, low: 0.0, high: 0.02}
  periods: 30.0
appendage: {frequencies: [3.0]}
"""


@pytest.mark.parametrize("text", [MESSAGE, repr(POINTS), f"points: {POINTS!r}"])
def test_files_are_read_where_the_trial_is_and_recorded(tmp_path: Path, text: str) -> None:
    (tmp_path / "slew.yaml").write_text(text)
    (tmp_path / "identified.yaml").write_text(IDENTIFIED)
    plan = {
        "method": "input_shaping",
        "trajectory": str(tmp_path / "slew.yaml"),
        "modes": str(tmp_path / "identified.yaml"),
    }
    settings: Any = trial_of_values({"plan": plan}, "trial.yaml").plan
    assert [point.at for point in settings.trajectory] == [0.0, 2.0]
    assert settings.trajectory[1].position == {"base_yaw": 0.5}
    frequency = settings.modes[
        0
    ].frequency  # with the joints held, as wide as that of the free mode
    assert [frequency.value, frequency.low, frequency.high] == pytest.approx([3.0, 2.85, 3.15])
    by_hand = planned(trajectory=POINTS, frequencies=[3.0], damping=0.01)
    plan_of_file = make_plan(settings, plant(PERIOD, (150.0, 150.0)))
    assert plan_of_file.position.tobytes() == by_hand.position.tobytes()


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"trajectory": POINTS, "goal": {"base_yaw": 1.0}}, "goal: not with a trajectory"),
        ({"trajectory": POINTS, "duration": 3.0}, "duration: not with a trajectory"),
        ({"trajectory": []}, "trajectory: [] is not allowed: at least one"),
        ({"trajectory": [{"at": 1.0, "position": {"elbow": 1.0}}]}, "elbow is not a joint"),
        ({"trajectory": [*POINTS[::-1]]}, "trajectory.1.at: 0.0 is not allowed: later than"),
        ({"trajectory": "slew.yaml"}, "a file is read where the trial is read"),
        ({"modes": [{"frequency": {"value": 3.0, "low": 4.0}}]}, "3 is not between 4 and 3"),
        ({"modes": [{"frequency": 3.0}], "damping": 0.1}, "modes: give them, or frequencies"),
        ({"modes": [{"frequency": 0.0}]}, "frequency: above 0 rad/s"),
        ({"shaper": "zvx"}, "zvx"),
        ({"trajectory": POINTS, "shaper": "um_zv"}, "negative: true"),
    ],
)
def test_what_cannot_be_shaped_is_refused(values: dict[str, Any], words: str) -> None:
    with pytest.raises(BadInput) as error:
        planned(**values)
    assert words in str(error.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("3", "holds no trajectory"),
        ("joint_names: 3\npoints: []", "joint_names: 3 is not allowed: a list of names"),
        ("joint_names: [a, a]\npoints: []", "one joint or more, each once"),
        ("joint_names: [a]\npoints: [7]", "points.0"),
        ("joint_names: [a]\npoints: [{positions: [0.0]}]", "time_from_start"),
        (
            "joint_names: [a]\npoints: [{positions: [0, 1], time_from_start: 1}]",
            "one number for each",
        ),
        ("joint_names: [a]\npoints: [{positions: x, time_from_start: 1}]", "a list of numbers"),
        ("points: [{at: 1}]", "position"),
        ("{", "YAML"),
    ],
)
def test_a_file_without_a_trajectory_is_refused_by_name(
    tmp_path: Path, text: str, words: str
) -> None:
    path = tmp_path / "slew.yaml"
    path.write_text(text)
    plan = {"method": "input_shaping", "trajectory": str(path)}
    with pytest.raises(BadInput) as error:
        trial_of_values({"plan": plan}, "trial.yaml")
    assert words in str(error.value)
    assert "\n" not in str(error.value)
