"""A benchmark task as many environments at once: a batch, one step a tick of all members."""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from flexslew_lab.gym.episodes import Episodes, checked_actions, member_seed, option_member
from flexslew_lab.gym.members import Members
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput

_Flags = NDArray[np.bool_]


class VectorSlew(VectorEnv[Matrix, Matrix, Any]):
    """Members of a task in a batch; all end at the same tick, and the step after it resets them.

    Each member is that of an environment of its own with the same seed and actions.

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
        self.single_observation_space = self.episodes.observation_space
        self.single_action_space = self.episodes.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._generators = [seeding.np_random(None)[0] for _ in range(num_envs)]
        self._members = Members(self.episodes, num_envs)

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
        given = option_member(options)
        members = [member_seed(generator) for generator in self._generators]
        if given is not None:
            members = [int(one) for one in given]
            _require_count(members, count, "options.member")
        self._members.begin(members)
        return self._members.observations.copy(), {"member": np.array(members)}

    def step(self, actions: Any) -> tuple[Matrix, Vector, _Flags, _Flags, dict[str, Any]]:
        """Let actions act for a tick in all members; after the last tick: reset, and none acts.

        Returns:
            The observations of the next tick, the growth of the running scores, False, whether this
            was the last tick, and then in the last dictionary `score` and `failure` of each.

        Raises:
            BadInput: the actions have another shape or are not finite, or nothing was reset.
        """
        members, none = self._members, np.zeros(self.num_envs, np.bool_)
        if not members.has_begun:
            raise BadInput("reset the environments first", "step")
        if members.is_over:
            observations, info = self.reset()
            return observations, np.zeros(self.num_envs), none, none.copy(), info
        members.step(checked_actions(actions, (self.num_envs, self.episodes.joints)))
        over, info = np.full(self.num_envs, members.is_over), dict[str, Any]()
        if members.is_over:
            info = {"score": members.scores, "failure": np.array(members.failures, dtype=object)}
        return members.observations.copy(), members.rewards.copy(), none, over, info


def _require_count(given: Sequence[Any], count: int, key: str) -> None:
    if len(given) != count:
        raise BadInput(f"has {len(given)} entries, expected one for each of {count}", key)
