"""The run: start, pause, steps, resets, rates and remarks."""

from time import monotonic

from flexslew_msgs import srv

from flexslew_plant.bench.operation.run_state import PAUSED, RUNNING, WAITING
from flexslew_plant.graph import topics

from .charge import Charge
from .desk import WHO, Acts, Desk
from .settings import Settings

RATES = [1.0, 3.0, 10.0]  # more takes the processors from the planner
FAST = 0.25  # of all changes of the rate: as fast as it goes, for a moment
PATIENCE = 3.0  # with a bench that waits, until it is helped [wall s]


class Run:
    """Acts on the run."""

    def __init__(self, desk: Desk, charge: Charge, settings: Settings) -> None:
        self._desk, self._bench = desk, desk.bench
        self._help = [charge.brake_surely, charge.relieve, charge.bring_back]
        self._in_a_hurry = [
            charge.switch, charge.kill, charge.start_again, charge.brakes_at_once, settings.tune,
        ]  # fmt: skip
        self.acts: Acts = {
            self.pause: 2.0, self.start: 3.0, self.step: 2.0, self.reset: 1.0, self.rate: 2.0,
            self.note: 1.0, self.notes_at_once: 0.5,
        }  # fmt: skip

    def _is(self, state: str) -> bool:
        return bool(self._bench.state.state == state)

    def pause(self) -> str:
        """A bench that runs rests."""
        words = self._desk.operate(topics.PAUSE, self._is(RUNNING))
        self._desk.until(lambda: self._is(PAUSED))
        return words

    def start(self) -> str:
        """A bench that rests runs, if whom it waits for can be helped."""
        words = self._desk.operate(topics.START, self._is(PAUSED))
        self._get_going()
        return words

    def _get_going(self) -> None:
        """See that ticks pass; where the bench waits for one who cannot come, help it once."""
        end = monotonic() + PATIENCE
        while self._is(WAITING) and monotonic() < end:
            self._bench.first.listen(0.02)
        if self._is(WAITING):
            self._desk.do(self._desk.pick(self._help))
        self._desk.until(lambda: self._is(RUNNING))

    def step(self) -> str:
        """A bench that rests flies some ticks, and rests again."""
        if self._bench.state.active in self._bench.dead:
            return "nobody would answer"
        paused, ticks = self._is(PAUSED), int(self._desk.case.integers(30))
        reply = self._desk.ask(srv.Step, topics.STEP, ticks=ticks, who=WHO)
        words = self._desk.granted(reply.ok, reply.message, paused)
        if paused:
            self._desk.until(lambda: self._is(PAUSED) and self._bench.state.tick >= reply.tick)
        return words

    def reset(self) -> str:
        """The bench rests at tick 0."""
        epoch = self._bench.state.epoch
        words = self._desk.operate(topics.RESET, True)
        self._desk.until(lambda: self._is(PAUSED) and self._bench.state.epoch == epoch + 1)
        return words

    def rate(self) -> str:
        """It goes on at another rate, now and then in a rush before."""
        if self._desk.chance(0.1):
            return self._set_rate(self._desk.pick([-1.0, float("nan"), float("inf")]), False)
        if self._desk.chance(FAST):
            self._set_rate(0.0, True)
            for _ in range(3):
                self._desk.do(self._desk.pick(self._in_a_hurry))
        return self._set_rate(self._desk.pick(RATES), True)

    def _set_rate(self, rate: float, good: bool) -> str:
        before = float(self._bench.state.rate_factor)
        reply = self._desk.ask(srv.SetRate, topics.SET_RATE, rate_factor=rate, who=WHO)
        words = self._desk.granted(reply.ok, reply.message, good)
        expected = rate if good else before
        self._desk.until(lambda: bool(self._bench.state.rate_factor == expected))
        return words

    def note(self) -> str:
        """What says something is kept."""
        text = self._desk.pick(["", "  ", "it hums", "paused to look\nand to think"])
        reply = self._desk.ask(srv.Note, topics.NOTE, text=text, who=WHO)
        return self._desk.granted(reply.ok, reply.message, bool(text.strip()))

    def notes_at_once(self) -> str:
        """Two remarks at the same moment are both kept."""
        text = {"text": "me, too", "who": "bob"}
        one, other = self._bench.both(srv.Note, topics.NOTE, text, text)
        assert (one.ok, other.ok) == (True, True), (one, other, self._desk.diary)
        return f"{one.message}; {other.message}"
