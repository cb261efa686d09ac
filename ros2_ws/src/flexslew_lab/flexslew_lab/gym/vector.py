"""A benchmark task as many environments at once: a batch, one step a tick of all members."""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from flexslew_lab.gym.episodes import Episodes, checked_actions, member_seed
from flexslew_lab.studies.batch.fleet import BatchRunner
from flexslew_lab.studies.batch.stepped import SteppedBatch
from flexslew_lab.studies.batch.stepped_loop import StepArrays
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput

_Flags = NDArray[np.bool_]


class VectorSlew(VectorEnv[Matrix, Matrix, Any]):
    """Members of a task in a batch; all end at the same tick, and the step after it resets them.

    Each member is that of an environment of its own with the same seed and actions, to the
    tolerance of the batches.

    Args:
        num_envs: members, at least 1; groups of 64 are fastest.
        task: name of the task.
        base: see SlewEnvironment.
        authority: see SlewEnvironment.
        plan: see SlewEnvironment.
        render_mode: None; a batch has no picture.

    Raises:
        BadInput: there is no such task, a value is not allowed, or a batch does not fly the task.
    """

    metadata: ClassVar[dict[str, Any]] = {  # type: ignore[misc]
        "render_modes": [],
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int,
        task: str,
        base: Mapping[str, Any] | None = None,
        authority: float = 1.0,
        plan: Mapping[str, Any] | None = None,
        render_mode: str | None = None,
    ) -> None:
        if num_envs < 1:
            raise BadInput("at least 1", key="num_envs", value=num_envs)
        if render_mode is not None:
            words = "a batch has no picture; render one environment"
            raise BadInput(words, key="render_mode", value=render_mode)
        self.episodes, self.num_envs = Episodes(task, base, authority, plan), num_envs
        self._runner = BatchRunner(self.episodes.study, self.episodes.plans)
        self.single_observation_space = self.episodes.observation_space
        self.single_action_space = self.episodes.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._generators = [seeding.np_random(None)[0] for _ in range(num_envs)]
        self._batch: SteppedBatch | None = None
        self._over = False
        shape = num_envs, len(self.signals)
        self._observations, self._rewards = np.zeros(shape), np.zeros(num_envs)
        joints = self.episodes.action_space.shape[0]
        self._no_actions = np.zeros((num_envs, joints))

    @property
    def signals(self) -> tuple[str, ...]:
        """Names of the entries of an observation."""
        return self.episodes.signals

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Matrix, dict[str, Any]]:
        """Return the observations at tick 0 of new members, and their seeds as `member`.

        Args:
            seed: of the members that follow: member i has seed + i; or one for each.
            options: `member`: seeds of the members, one for each.

        Raises:
            BadInput: an option is not known, or there is not one seed for each member.
        """
        count = self.num_envs
        if seed is not None:
            seeds = [seed + k for k in range(count)] if isinstance(seed, int) else list(seed)
            _require_count(seeds, count, "seed")
            for k, one in enumerate(seeds):
                if one is not None:
                    self._generators[k] = seeding.np_random(one)[0]
        for name in options or {}:
            if name != "member":
                raise BadInput("is not known; allowed: member", "options", name)
        members = [member_seed(generator) for generator in self._generators]
        if options and "member" in options:
            members = [int(one) for one in options["member"]]
            _require_count(members, count, "options.member")
        episodes = self.episodes
        cases = [episodes.case(member) for member in members]
        self._batch = SteppedBatch(self._runner, cases, episodes.authority, episodes.terms)
        self._over = False
        self._step(self._no_actions)
        return self._observations.copy(), {"member": np.array(members)}

    def step(self, actions: Any) -> tuple[Matrix, Vector, _Flags, _Flags, dict[str, Any]]:
        """Let actions act for a tick in all members; after the last tick: reset, and none acts.

        Returns:
            The observations of the next tick, the growth of the running scores, False, whether this
            was the last tick, and then in the last dictionary `score` and `failure` of each.

        Raises:
            BadInput: the actions have another shape or are not finite, or nothing was reset.
        """
        if self._batch is None:
            raise BadInput("reset the environments first", "step")
        given = checked_actions(actions, self._no_actions.shape)
        none = np.zeros(self.num_envs, np.bool_)
        if self._over:
            observations, info = self.reset()
            return observations, np.zeros(self.num_envs), none, none.copy(), info
        self._step(given)
        self._over = self._batch.tick == self._batch.ticks
        rewards, info = self._rewards.copy(), dict[str, Any]()
        if self._over:
            metrics, episodes = self._batch.metrics(), self.episodes
            score = np.array([episodes.score(one) for one in metrics])
            failure = np.array([episodes.failure(one) for one in metrics], dtype=object)
            info = {"score": score, "failure": failure}
            rewards += score - self._batch.running_scores() - episodes.unmeasured
        return self._observations.copy(), rewards, none, np.full_like(none, self._over), info

    def _step(self, actions: Matrix) -> None:
        assert self._batch is not None
        self._batch.step(StepArrays(actions, self._observations, self._rewards))


def _require_count(given: Sequence[Any], count: int, key: str) -> None:
    if len(given) != count:
        raise BadInput(f"has {len(given)} entries, expected one for each of {count}", key)
