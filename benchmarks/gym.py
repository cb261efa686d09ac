"""Steps of the environments, and of a batch, beside those of the bench that they are made of.

`./flexslew bench gym`; needs the extra `gym`.
"""

from statistics import median
from time import perf_counter
from typing import Any

import gymnasium
import numpy as np

from flexslew_lab.gym.environment import SlewEnvironment
from flexslew_lab.gym.vector import VectorSlew
from flexslew_lab.studies.batch.fleet import BatchRunner

TASK = "csa-slew"
BASE: dict[str, Any] = {"base": {"kp": [460.0, 460.0], "kd": [920.0, 920.0]}, "authority": 0.2}
MEMBERS = 4096
ROUNDS = 3


def _rate(step: Any, actions: Any, count: int) -> float:
    """Return steps of all members per second; the first ones load and compile."""
    for _ in range(10):
        step(actions)
    started = perf_counter()
    for _ in range(count):
        step(actions)
    return count * len(np.atleast_2d(actions)) / (perf_counter() - started)


def figures() -> dict[str, float]:
    """Return steps per second, and the ratios between them in rounds that follow each other."""
    single = SlewEnvironment(TASK, **BASE)
    single.reset(seed=1)
    many = VectorSlew(MEMBERS, TASK, **BASE)
    many.reset(seed=1)
    in_turn = gymnasium.vector.SyncVectorEnv([lambda: SlewEnvironment(TASK, **BASE)] * 4)
    in_turn.reset(seed=1)
    rates: dict[str, list[float]] = {"single": [], "sync": [], "batch": []}
    for _ in range(ROUNDS):
        rates["single"].append(_rate(single.step, np.full(2, 0.1), 400))
        rates["sync"].append(_rate(in_turn.step, np.full((4, 2), 0.1, np.float32), 100))
        rates["batch"].append(_rate(many.step, np.full((MEMBERS, 2), 0.1), 200))
    ratios = [batch / sync for batch, sync in zip(rates["batch"], rates["sync"], strict=True)]
    runner, episodes = BatchRunner(many.episodes.study, many.episodes.plans), many.episodes
    cases = [episodes.case(seed) for seed in range(64 * 4)]
    flown = []
    for _ in range(2):  # the first one compiles
        started = perf_counter()
        list(runner.fly(cases))
        flown.append(len(cases) * episodes.ticks / (perf_counter() - started))
    return {
        "gym_single_steps_per_s": median(rates["single"]),
        "gym_sync_steps_per_s": median(rates["sync"]),
        f"gym_batch_steps_per_s_{MEMBERS}_members": median(rates["batch"]),
        "gym_batch_over_sync": median(ratios),
        "gym_batch_over_flights_without_actions": median(rates["batch"]) / flown[1],
    }


if __name__ == "__main__":
    for name, value in figures().items():
        print(f"{name:45} {value:14,.2f}")
