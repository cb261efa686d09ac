"""The way from a page to a bench in the same process."""

from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from typing import Any

from flexslew_lab.console.in_process.operated_bench import OperatedBench
from flexslew_lab.console.link import SHOWN_TOPICS, Iterate, PlanCallback, RequestResult, Then
from flexslew_lab.console.view import BenchView, Now
from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.recording.bag_observer import BagObserver
from flexslew_lab.run.run_trial import PreparedTrial
from flexslew_plant.bench.operation.run_state import WAITING
from flexslew_plant.errors import BadInput
from flexslew_plant.graph import topics
from flexslew_plant.own_code import NO_CODE, Trust

_BACKLOG = 5000  # messages for the page, beyond which the bench waits for it
_NOT_YET = RequestResult(False, "the bench is not there yet: its plan is being made")
_OVER = RequestResult(False, "the run is over")


class InProcessLink:
    """A console.link.BenchLink over a bench that another thread of this process flies.

    Args:
        folder: of the run.
        command: that repeats the run.
        trust: which testbeds of the user's own may be loaded, to be drawn.
    """

    replay = False

    def __init__(self, folder: str, command: str, trust: Trust = NO_CODE) -> None:
        self.view, self.folder, self.command = BenchView(trust), folder, command
        self.view.now = Now(WAITING, ("the plan of the trial",))
        self._messages: deque[tuple[str, bytes]] = deque()  # name of the topic and CDR
        self._replies: deque[Callable[[], None]] = deque()
        self._bench: OperatedBench | None = None
        self._shown = set(SHOWN_TOPICS)
        self._is_over = False

    def fly(
        self, prepared: PreparedTrial, observer: BagObserver, progress: Callable[[int], None]
    ) -> None:
        """Fly a trial as the operator of the page requests, in the thread that calls this.

        Args:
            prepared: trial to fly.
            observer: writes its log.
            progress: called with the tick.
        """
        observer.written = self._take
        self._bench = OperatedBench(prepared, observer, lambda: len(self._messages) > _BACKLOG)
        try:
            self._bench.fly(progress)
        finally:
            self._is_over = True

    def poll(self, now: float) -> None:
        """Take what the bench has written since the last call, and deliver its answers."""
        bench = self._bench
        state = bench.now if bench is not None else None  # before the newest messages are taken
        batches: dict[str, list[bytes]] = {}
        for _ in range(len(self._messages)):
            name, data = self._messages.popleft()
            batches.setdefault(name, []).append(data)
        for name, batch in batches.items():
            with suppress(BadInput):
                self.view.take(name, TOPICS[f"/{name}"].type, batch)
        if state is not None:
            self.view.now = state
        while self._replies:
            self._replies.popleft()()

    def ask(self, service: str, values: Mapping[str, Any], then: Then) -> None:
        """Request something of the bench; see console.link.BenchLink.ask."""
        bench = self._ready_bench(then)
        if bench is not None:
            bench.submit(partial(bench.serve, service, dict(values), partial(self._reply, then)))

    def draft(
        self, request: str, who: str, progress: Callable[[Iterate], None], then: PlanCallback
    ) -> None:
        """Request a manoeuvre that no controller follows yet."""
        bench = self._ready_bench(lambda result: then(result, None))
        if bench is not None:
            iterate = partial(self._reply, progress)
            bench.submit(
                partial(bench.plans.draft, request, who, iterate, partial(self._reply, then))
            )

    def cancel(self) -> None:
        """Give up the plan that is being made."""
        if self._bench is not None:
            self._bench.submit(self._bench.plans.cancel)

    def measure(self, on: bool) -> None:
        """Add the sensor readings of every tick to the view, or stop adding them."""
        self._shown = {*SHOWN_TOPICS, topics.MEASUREMENT} if on else set(SHOWN_TOPICS)

    def _ready_bench(self, then: Then) -> OperatedBench | None:
        """Return the bench that takes requests; else answer why there is none."""
        if self._bench is None or self._is_over:
            then(_OVER if self._is_over else _NOT_YET)
            return None
        return self._bench

    def _reply(self, then: Callable[..., None], *answer: Any) -> None:
        self._replies.append(partial(then, *answer))

    def _take(self, topic: str, data: bytes) -> None:
        name = topic.removeprefix("/")
        if name in self._shown:
            self._messages.append((name, data))
