"""Members of a task between two ticks, in a batch: what one environment and many have in common."""

from collections.abc import Sequence

import numpy as np

from flexslew_lab.gym.episodes import Episodes
from flexslew_lab.studies.batch.fleet import BatchRunner
from flexslew_lab.studies.batch.stepped import SteppedBatch
from flexslew_lab.studies.batch.stepped_loop import StepArrays
from flexslew_plant.arrays import Matrix, Vector


class Members:
    """Flies members of a task a tick at a time; see docs/train_a_policy.md.

    Args:
        episodes: of the task.
        count: members.
    """

    def __init__(self, episodes: Episodes, count: int) -> None:
        self._episodes, self._runner = episodes, BatchRunner(episodes.study, episodes.plans)
        self._shape = count, episodes.joints
        self._batch: SteppedBatch | None = None
        # of the present tick, (members, signals), and the growth of the running scores, (members,)
        self.observations, self.rewards = np.zeros((count, len(episodes.signals))), np.zeros(count)
        self.scores, self.failures = np.zeros(count), [""] * count  # at the end

    def begin(self, seeds: Sequence[int]) -> None:
        """Observe tick 0 of the members of these seeds.

        Raises:
            BadInput: batches do not fly the task.
        """
        episodes = self._episodes
        cases = [episodes.case(seed) for seed in seeds]
        self._batch = SteppedBatch(self._runner, cases, episodes.authority, episodes.terms)
        self._advance(np.zeros(self._shape))

    def step(self, actions: Matrix) -> None:
        """Let actions, (members, joints), act for a tick; the last one gives scores, too."""
        assert self._batch is not None
        self._advance(actions)
        if self.is_over:
            episodes, metrics = self._episodes, self._batch.metrics()
            self.scores = np.array([episodes.score(one) for one in metrics])
            self.failures = [episodes.failure(one) for one in metrics]
            self.rewards += self.scores - self._batch.running_scores() - episodes.unmeasured

    @property
    def has_begun(self) -> bool:
        """Whether there is a tick."""
        return self._batch is not None

    @property
    def is_over(self) -> bool:
        """Whether the last tick is observed, or nothing has begun."""
        return self._batch is None or self._batch.tick == self._batch.ticks

    @property
    def tick(self) -> int:
        """The present one."""
        return self._batch.tick if self._batch else 0

    @property
    def time(self) -> float:
        """Of the present tick [s]."""
        return self.tick * self._episodes.task.trial.period

    def positions(self, member: int) -> Vector:
        """Return the positions of a member at the present tick, shape (positions,)."""
        assert self._batch is not None
        return self._batch.positions(member)

    def _advance(self, actions: Matrix) -> None:
        assert self._batch is not None
        self._batch.step(StepArrays(actions, self.observations, self.rewards))
