"""The log of a run, behind the same link as a live bench."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from flexslew_lab.console.link import SHOWN_TOPICS, Iterate, PlanCallback, RequestResult, Then
from flexslew_lab.console.view import BenchView, Now
from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.replay.player import Outgoing, Player, PlaySettings
from flexslew_plant.errors import BadInput
from flexslew_plant.graph import topics
from flexslew_plant.own_code import NO_CODE, Trust

_BEFORE = 300.0  # shown before the time that is gone to [s]
_WORDS = "this is a log; it takes no commands"


class Replay:
    """A console.link.Link, and the recording behind it.

    Attributes:
        first, last, time: of the log, now [s]: simulated, and after a reset they go on.

    Args:
        bag: its folder or file.
        trust: which testbeds of the user's own may be loaded.

    Raises:
        BadInput: the bag cannot be read.
    """

    replay = True

    def __init__(self, bag: Path, trust: Trust = NO_CODE) -> None:
        available = Player(PlaySettings(bag=str(bag))).topics
        selected_topics = tuple(f"/{name}" for name in SHOWN_TOPICS if f"/{name}" in available)
        if f"/{topics.TRUTH}" not in selected_topics:
            raise BadInput("holds no truth", bag)
        self._player = Player(PlaySettings(bag=str(bag), topics=selected_topics, paused=True))
        self.view, self.folder = BenchView(trust), str(bag.parent if bag.name == "bag" else bag)
        self.command = f"./flexslew resim {self.folder}"
        self.first, self.last = self._player.first * 1e-9, self._player.last * 1e-9
        self.time = self.first
        self._ticks = self._last_tick()
        self.seek(self.first)

    @property
    def playing(self) -> bool:
        """Time passes."""
        return not self._player.paused

    def poll(self, now: float) -> None:
        """Take what is due."""
        self._take(self._player.due(now, 100_000))
        if self._player.done:
            self._player.pause()
        view = self.view
        period = view.joints.period if view.joints else 0.01
        state = "replaying" if self.playing else "paused"
        rate = self._player.settings.rate
        view.now = Now(
            state, tick=round(view.time / period), last_tick=self._ticks,
            rate_factor=rate, active=view.answering,
        )  # fmt: skip

    def play(self, rate: float) -> None:
        """Go on from here at a rate; 0: rest."""
        self._player.pause()
        if rate > 0.0:
            self._player.settings = replace(self._player.settings, rate=rate)
            self._player.resume()

    def seek(self, time: float) -> RequestResult:
        """Go to a time of the log [s]; what came before it is read, too."""
        return self._seek(time, _BEFORE)

    def _last_tick(self) -> int:
        """Return the last tick of the run; 0 after a reset, where each epoch has a last tick."""
        self._seek(self.last, 1.0)
        period = self.view.joints.period if self.view.joints else 0.01
        once = abs(self.view.time - self.time) < 0.5 * period
        return round(self.last / period) if once else 0

    def _seek(self, time: float, before: float) -> RequestResult:
        try:
            self._player.seek(min(max(time - before, self.first), self.last))
        except BadInput as error:
            return RequestResult(False, str(error))
        self.view.clear()
        self._take(self._player.step(time + 1e-6))
        return RequestResult(True, f"at {self.view.time:.2f} s")

    def ask(self, service: str, values: Mapping[str, Any], then: Then) -> None:
        """Refuse."""
        then(RequestResult(False, _WORDS))

    def draft(
        self, request: str, who: str, progress: Callable[[Iterate], None], then: PlanCallback
    ) -> None:
        """Refuse."""
        then(RequestResult(False, _WORDS), None)

    def cancel(self) -> None:
        """Nothing is being made."""

    def measure(self, on: bool) -> None:
        """Nothing is shaken."""

    def _take(self, messages: Iterable[Outgoing]) -> None:
        batches: dict[str, list[bytes]] = {}
        for message in messages:
            if message.topic == f"/{topics.TRUTH}":
                self.time = message.stamp * 1e-9
            batches.setdefault(message.topic, []).append(message.data)
        for topic, data in batches.items():
            self.view.take(topic.lstrip("/"), TOPICS[topic].type, data)
