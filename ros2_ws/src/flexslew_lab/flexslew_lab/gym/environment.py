"""A benchmark task as an environment: one member on the bench, one step a tick."""

from collections.abc import Mapping
from typing import Any, ClassVar

import gymnasium
import numpy as np

from flexslew_control.plan import Plan
from flexslew_lab.gym.episodes import Episodes, checked_actions, member_seed
from flexslew_lab.gym.picture import ScenePicture
from flexslew_lab.gym.running_score import RunningScore
from flexslew_lab.run.metrics_observer import MetricsObserver
from flexslew_lab.studies.flight import columns_of
from flexslew_lab.trial.trial import set_plan, set_up
from flexslew_plant.arrays import Vector
from flexslew_plant.bench.bench import Bench
from flexslew_plant.errors import BadInput
from flexslew_plant.events import Started

_FRAMES = 25  # pictures in a second of simulated time

Step = tuple[Vector, float, bool, bool, dict[str, Any]]


class SlewEnvironment(gymnasium.Env[Vector, Any]):
    """One member of a task; each reset draws another one.

    Observations, actions, rewards and ends: see docs/train_a_policy.md.

    Args:
        task: name of the task.
        base: keys of pd_feedforward, whose efforts the actions are added to; None: zero.
        authority: effort of an action of one, as a share of the limit.
        plan: keys of a `plan` section in place of the task's.
        render_mode: rgb_array, human, or None.

    Raises:
        BadInput: there is no such task, or a value is not allowed.
    """

    metadata: ClassVar[dict[str, Any]] = {  # type: ignore[misc]
        "render_modes": ["human", "rgb_array"],
        "render_fps": _FRAMES,
    }

    def __init__(
        self,
        task: str,
        base: Mapping[str, Any] | None = None,
        authority: float = 1.0,
        plan: Mapping[str, Any] | None = None,
        render_mode: str | None = None,
    ) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise BadInput("give human, rgb_array or None", key="render_mode", value=render_mode)
        self._episodes, self.render_mode = Episodes(task, base, authority, plan), render_mode
        self.observation_space = self._episodes.observation_space
        self.action_space = self._episodes.action_space
        self._picture: ScenePicture | None = None
        self._bench: Bench | None = None

    @property
    def signals(self) -> tuple[str, ...]:
        """Names of the entries of an observation."""
        return self._episodes.signals

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Vector, dict[str, Any]]:
        """Return the observation at tick 0 of a new member, and its seed as `member`.

        Args:
            seed: of the members that follow.
            options: `member`: seed of the member, as the benchmark's development seeds.

        Raises:
            BadInput: an option is not known.
        """
        super().reset(seed=seed)
        for name in options or {}:
            if name != "member":
                raise BadInput("is not known; allowed: member", "options", name)
        number = member_seed(self.np_random)
        number = int((options or {}).get("member", number))
        trial, episodes = self._episodes.trial(number), self._episodes
        bench, controllers = set_up(trial, trial.name)
        made: Plan | None = episodes.plan(trial)
        refusal = set_plan(controllers, trial.active, made)
        if refusal is not None:
            raise BadInput(str(refusal), trial.name)
        self._bench, self._controller = bench, controllers[trial.active]
        self._law: Any = self._controller.law
        self._observer = MetricsObserver(bench, made)
        self._running = RunningScore(bench, made, episodes.terms)
        self._steps = 0
        bench.tell(Started())
        self._score = self._measured(bench)
        self._observation = self._observe(bench)
        if self.render_mode == "human":
            self.render()
        return self._observation, {"member": number}

    def step(self, action: Any) -> Step:
        """Let an action act for a tick.

        Returns:
            The observation of the next tick, the growth of the running score, False, whether this
            was the last tick, and then in the last dictionary `score` and `failure`.

        Raises:
            BadInput: the action has another shape or is not finite, or the environment is not
                reset.
        """
        bench, episodes = self._bench, self._episodes
        if bench is None or self._steps >= episodes.ticks:
            raise BadInput("reset the environment first", "step")
        self._law.action = checked_actions(action, self._law.limit.shape)
        if not bench.failure:
            answer = self._controller.observe(bench.question)
            if answer is not None:
                bench.offer(answer.command)
            bench.advance()
        before = self._score
        if not bench.failure:
            self._score = self._measured(bench)
            self._observation = self._observe(bench)
        self._steps += 1
        over, info = self._steps == episodes.ticks, dict[str, Any]()
        reward = self._score - before
        if over:
            metrics = None if bench.failure else columns_of(self._observer.result())
            info = {"score": episodes.score(metrics), "failure": episodes.failure(metrics)}
            reward += info["score"] - self._score - episodes.unmeasured
        if self.render_mode == "human" and self._steps % self._ticks_per_frame == 0:
            self.render()
        return self._observation, reward, False, over, info

    def render(self) -> Any:
        """Return a picture of the testbed, shape (height, width, 3) of uint8, or show it."""
        if self._bench is None or self.render_mode is None:
            return None
        if self._picture is None:
            self._picture = ScenePicture(self._bench.testbed, self.render_mode == "human")
        truth = self._bench.truth()
        return self._picture.draw(truth.position, truth.time)

    def close(self) -> None:
        """Close the picture and the bench."""
        if self._picture is not None:
            self._picture.close()
            self._picture = None
        if self._bench is not None:
            self._bench.close()
            self._bench = None

    @property
    def _ticks_per_frame(self) -> int:
        return max(round(1.0 / (_FRAMES * self._episodes.task.trial.period)), 1)

    def _observe(self, bench: Bench) -> Vector:
        """Return the observation of this tick; the controller's estimator takes its measurement."""
        question, controller = bench.question, self._controller
        controller.observe(question._replace(controller=""))  # estimated, and not answered yet
        observed: Vector = self._law.observe(
            question, controller.estimate, controller.reference(question.tick)
        )
        return np.where(np.isfinite(observed), observed, 0.0)

    def _measured(self, bench: Bench) -> float:
        """Return the running score after the truth and the events of this tick."""
        truth = bench.truth()
        self._observer.truth(truth)
        while bench.events:
            self._observer.event(bench.events.popleft())
        return self._running.update(truth)
