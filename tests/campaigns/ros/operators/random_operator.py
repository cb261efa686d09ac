"""An operator who does anything at any moment."""

from time import monotonic

import numpy as np

from flexslew_plant.bench.operation.run_state import PAUSED

from .bench import OperatedBench
from .charge import Charge
from .desk import Desk, Entry, Habits
from .plans import Plans
from .run import PATIENCE, Run
from .settings import Settings


class RandomOperator:
    """Draws what is done to a bench; each act checks its answer against what the pages promise.

    Args:
        bench: that is operated.
        habits: what is asked of it.
        case: what is drawn from.
    """

    def __init__(self, bench: OperatedBench, habits: Habits, case: np.random.Generator) -> None:
        self._bench, self._desk = bench, Desk(bench, habits, case)
        self._charge, settings = Charge(self._desk), Settings(self._desk)
        self._run = Run(self._desk, self._charge, settings)
        self._plans = Plans(self._desk)
        fields = self._charge.acts, settings.acts, self._run.acts, self._plans.acts
        self._acts = {act: share for acts in fields for act, share in acts.items()}

    @property
    def diary(self) -> list[Entry]:
        """What was done."""
        return self._desk.diary

    def work(self, acts: int) -> None:
        """Do so many things, one after another."""
        shares = np.array(list(self._acts.values()))
        for at in self._desk.case.choice(len(shares), acts, p=shares / shares.sum()):
            self._desk.do(list(self._acts)[at])

    def tidy_up(self) -> None:
        """Have everybody back, nothing broken, the brake released and somebody in charge."""
        while self._bench.dead:
            self._desk.do(self._charge.start_again)
        self._plans.end_all()
        if self._bench.state.state == PAUSED:
            self._desk.do(self._run.start)
        self._desk.do(self._charge.responses)
        if not self._all_ready():  # a planner that was started in flight knows no plan of it
            self._desk.do(self._run.reset)
            self._desk.do(self._run.start)
        self._desk.until(self._all_ready)
        if self._desk.braked:  # to get the bench going, too
            self._desk.do(self._charge.release)
        self._pass_by(10)  # what is due with the next tick has come
        self._desk.do(self._charge.take_charge)
        self._pass_by(50)

    def _pass_by(self, ticks: int) -> None:
        """Let so many ticks pass."""
        end = int(self._bench.state.tick) + ticks
        self._desk.until(lambda: bool(self._bench.state.tick >= end))

    def _all_ready(self) -> bool:
        """Return whether all could take charge, or can in a moment."""
        end = monotonic() + PATIENCE
        while self._bench.ready()[1] != {*self._bench.controllers}:
            if monotonic() > end:
                return False
            self._bench.first.listen(0.05)
        return True
