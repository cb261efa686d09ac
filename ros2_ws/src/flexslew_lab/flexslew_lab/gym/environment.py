"""A benchmark task as an environment: one member, one step a tick."""

from collections.abc import Mapping
from typing import Any, ClassVar

import gymnasium
import numpy as np

from flexslew_lab.gym.episodes import Episodes, checked_actions, member_seed, option_member
from flexslew_lab.gym.members import Members
from flexslew_lab.gym.picture import ScenePicture
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput

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
        self._members = Members(self._episodes, 1)
        self._picture: ScenePicture | None = None
        self._frame_ticks = max(round(1.0 / (_FRAMES * self._episodes.task.trial.period)), 1)

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
        given, drawn = option_member(options), member_seed(self.np_random)
        member = drawn if given is None else int(given)
        self._members.begin([member])
        if self.render_mode == "human":
            self.render()
        return self._members.observations[0].copy(), {"member": member}

    def step(self, action: Any) -> Step:
        """Let an action act for a tick.

        Returns:
            The observation of the next tick, the growth of the running score, False, whether this
            was the last tick, and then in the last dictionary `score` and `failure`.

        Raises:
            BadInput: the action has another shape or is not finite, or the environment is not
                reset.
        """
        members = self._members
        if members.is_over:
            raise BadInput("reset the environment first", "step")
        members.step(checked_actions(action, (self._episodes.joints,))[np.newaxis])
        over, info = members.is_over, dict[str, Any]()
        if over:
            info = {"score": float(members.scores[0]), "failure": members.failures[0]}
        if self.render_mode == "human" and members.tick % self._frame_ticks == 0:
            self.render()
        return members.observations[0].copy(), float(members.rewards[0]), False, over, info

    def render(self) -> Any:
        """Return a picture of the testbed, shape (height, width, 3) of uint8, or show it."""
        members = self._members
        if not members.has_begun or self.render_mode is None:
            return None
        if self._picture is None:
            self._picture = ScenePicture(self._episodes.testbed, self.render_mode == "human")
        return self._picture.draw(members.positions(0), members.time)

    def close(self) -> None:
        """Close the picture."""
        if self._picture is not None:
            self._picture.close()
            self._picture = None
