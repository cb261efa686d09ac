"""What one plan does on one bench: the numbers and curves of a comparison."""

from dataclasses import dataclass, replace

import numpy as np

from flexslew_control.plan import Plan
from flexslew_lab.metrics.settling import BAND
from flexslew_lab.run.in_process import Observer, fly
from flexslew_lab.trial.trial import Trial, bench_settings, build_controllers, follow
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.bench.bench import Bench, Truth

SHOWN = 600  # samples of a curve


@dataclass(frozen=True)
class PlanFlight:
    """What one method did on one bench."""

    error: float  # of the stiffness [-]
    payload: float  # error of what the testbed carries [-]
    residual_tip: float  # largest |tip deflection| after the end [m]
    residual_joint: float  # largest |joint - goal| after the end [rad or m]
    settling_time: float  # of the slowest joint, from the start of the plan [s]
    peak_position: Vector  # farthest from the start, (joints,) [rad or m]
    overshoot: Vector  # beyond the goal as a fraction of the distance, or NaN, (joints,) [-]
    peak_effort: Vector  # (joints,) [N m or N]
    effort: float  # integral of the sum of squared efforts to the end of the run [(N m)^2 s]
    time: Vector  # (samples,) [s]
    position: Matrix  # (samples, joints) [rad or m]
    tip: Vector  # the largest appendage's deflection, with its sign, (samples,) [m]
    applied: Matrix  # (samples, joints) [N m or N]


class TruthLog(Observer):
    """Keeps the truth."""

    def __init__(self) -> None:
        self.truths: list[Truth] = []

    def truth(self, truth: Truth) -> None:
        """Take the state at a tick."""
        self.truths.append(truth)


def flown(
    trial: Trial, source: str, plan: Plan, error: float, payload: float, longest: float
) -> tuple[str, PlanFlight | None]:
    """Return the flight of a plan on the bench with these errors, or why the law refuses it."""
    flown = trial.testbed.scaled(stiffness=1.0 + error, payload=1.0 + payload)
    other = replace(trial, testbed=flown)
    bench = Bench(bench_settings(other))
    controllers = build_controllers(other, bench, source)
    if (refused := follow(controllers, other.active, plan)) is not None:
        return str(refused), None
    truth_log = TruthLog()
    fly(bench, controllers, truth_log)
    # a step has no end of its own
    end = plan.end if plan.duration > 0.0 else longest
    return "", _measured(truth_log.truths, plan, (error, payload), end)


def _measured(
    truths: list[Truth], plan: Plan, errors: tuple[float, float], end: float
) -> PlanFlight:
    time = np.array([truth.time for truth in truths])
    joints = len(plan.joint_names)
    position = np.array([truth.position[:joints] for truth in truths])
    tips = np.array([truth.tip_deflection for truth in truths])
    applied = np.array([truth.applied_effort for truth in truths])
    largest = np.take_along_axis(tips, np.abs(tips).argmax(axis=1)[:, None], axis=1)[:, 0]
    goal = plan.position[-1]
    away = np.abs(position - goal)
    distance = np.abs(goal - position[0])
    outside = (away > BAND * np.where(distance > 0.0, distance, distance.max())).any(axis=1)
    over = time >= end - 1e-9
    settled = float(time[outside][-1]) - plan.start if outside.any() else 0.0
    held = np.diff(time, prepend=time[0])
    moved = position - position[0]
    beyond = np.maximum(((position - goal) * np.sign(goal - position[0])).max(axis=0), 0.0)
    shown = np.unique(np.linspace(0, len(time) - 1, SHOWN).astype(int))
    return PlanFlight(
        error=errors[0],
        payload=errors[1],
        residual_tip=float(np.abs(largest[over]).max()),
        residual_joint=float(away[over].max()),
        settling_time=settled,
        peak_position=np.take_along_axis(position, np.abs(moved).argmax(axis=0)[None], axis=0)[0],
        overshoot=np.divide(beyond, distance, out=np.full(joints, np.nan), where=distance > 0.0),
        peak_effort=np.abs(applied).max(axis=0),
        effort=float((applied**2).sum(axis=1) @ held),
        time=time[shown],
        position=position[shown],
        tip=largest[shown],
        applied=applied[shown],
    )
