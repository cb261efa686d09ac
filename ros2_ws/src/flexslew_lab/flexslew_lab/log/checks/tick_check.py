"""Are the ticks of a log whole: every one, in order, and about each of them one word only?"""

from collections.abc import Container, Iterator, Mapping

import numpy as np

from flexslew_lab.log.bag_columns import ColumnBlock
from flexslew_lab.log.bag_layout import RUN_RECORD
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.checks.blind_sensors import BlindSensors
from flexslew_lab.log.checks.end_check import check_ends
from flexslew_lab.log.checks.finding import Finding as Finding
from flexslew_plant.counted import counted
from flexslew_plant.events import Started, SwitchRefused

TICKED = ("/truth", "/measurement", "/effort_command", "/controller_state")
_ANSWERS = ("/effort_command", "/controller_state")
_TERMS = ("term_names", "terms")  # of which a law has one more while it takes over

Key = tuple[int, int]  # epoch and tick
Columns = Mapping[str, np.ndarray]


class _Sender:
    """All messages of one sender about each tick, block after block.

    A question is repeated until it is answered, and each repetition gets the same answer; a
    different message about the same tick is an error.

    Args:
        refused: epochs and ticks at which a refused switch returned the question to another.
    """

    def __init__(self, refused: Container[Key]) -> None:
        self._refused = refused
        self.repeated, self.contradictions, self.backwards, self.resized = 0, 0, 0, 0
        self._last: Columns = {}  # its last message

    def add(self, columns: Columns) -> None:
        """Take the next messages."""
        before = self._last or {name: column[:1] for name, column in columns.items()}
        self.resized += any(
            column.shape[1:] != before[name].shape[1:]
            for name, column in columns.items()
            if name not in _TERMS
        )
        tick, epoch, sec, nanosec = (
            np.append(before[name], columns[name]).astype(np.int64)
            for name in ("tick", "epoch", *_stamp_names(columns))
        )
        same = np.diff(epoch) == 0
        self.backwards += int((same & (np.diff(sec * 10**9 + nanosec) < 0)).sum())
        for k in np.flatnonzero(same & (np.diff(tick) == 0)).tolist():
            if k or self._last:
                earlier = {n: c[k - 1 : k] for n, c in columns.items()} if k else before
                self._check_repeat(earlier, {n: c[k : k + 1] for n, c in columns.items()})
        self._last = {name: column[-1:].copy() for name, column in columns.items()}

    def _check_repeat(self, earlier: Columns, later: Columns) -> None:
        """Take two messages about one tick."""
        other = {name for name, value in later.items() if not _same(earlier[name], value)}
        key = int(later["epoch"][0]), int(later["tick"][0])
        self.repeated += not other
        self.contradictions += bool(other) and (other != {"controller"} or key not in self._refused)


class _Topic:
    """A topic of every tick, block after block.

    Args:
        name: of the topic.
        refused: see _Sender.
        blind: which readings may be NaN.
    """

    def __init__(self, name: str, refused: Container[Key], blind: BlindSensors) -> None:
        self._name, self._refused, self._blind = name, refused, blind
        self._senders: dict[str, _Sender] = {}
        self.messages, self._gaps, self._missing = 0, 0, 0
        self._not_finite, self._blinded = 0, 0
        self._first_gap = ""
        self.newest: Key = (0, -1)  # -1: none
        self.first: dict[int, int] = {}  # tick of each epoch
        self.last: dict[int, int] = {}

    def add(self, block: ColumnBlock) -> None:
        """Take the next messages."""
        columns = block.columns
        self.messages += len(block.stamp)
        for name, column in columns.items():
            if column.dtype.kind == "f" and not np.isfinite(column).all():
                self._find(name, columns)
        self._follow(columns["epoch"].astype(np.int64), columns["tick"].astype(np.int64))
        # a block has one layout, and with it one text; late answers come among those of others
        name = str(columns["controller"][0]) if self._name in _ANSWERS else ""
        self._senders.setdefault(name, _Sender(self._refused)).add(columns)

    def _find(self, name: str, columns: Columns) -> None:
        """Count the numbers of a column that are not finite, with a reason and without."""
        wrong = ~np.isfinite(columns[name])
        blind = np.zeros(len(wrong), dtype=bool)
        if self._name == "/measurement":
            blind = self._blind.at(name, columns["epoch"], columns["tick"])
        self._blinded += int(wrong[blind].sum())
        self._not_finite += int(wrong[~blind].sum())

    def _follow(self, epoch: np.ndarray, tick: np.ndarray) -> None:
        """Count the ticks that are missing from the sequence, whichever node sends."""
        for number in np.unique(epoch):
            ticks = tick[epoch == number]
            self.first.setdefault(int(number), int(ticks[0]))
            self.last[int(number)] = max(self.last.get(int(number), 0), int(ticks.max()))
            last = self.newest[1] if number == self.newest[0] else -1
            last = ticks[0] - 1 if last < 0 else last
            newest = np.maximum.accumulate(np.append(last, ticks))
            step = np.diff(newest)
            gap = step > 1
            if gap.any() and not self._first_gap:
                k = int(np.argmax(gap))
                self._first_gap = f"first between tick {newest[k]} and {newest[k + 1]}"
            self._gaps += int(gap.sum())
            self._missing += int((step[gap] - 1).sum())
            self.newest = max(self.newest, (int(number), int(newest[-1])))

    def finding(self) -> Finding:
        """Return what is wrong with it, if anything."""
        if not self.messages:
            return Finding(False, self._name, "not in the log")
        senders = self._senders.values()
        repeated = sum(sender.repeated for sender in senders)
        contradictions = sum(sender.contradictions for sender in senders)
        backwards = sum(sender.backwards for sender in senders)
        resized = sum(sender.resized for sender in senders)
        gaps = f"{counted(self._gaps, 'gap')}, {self._first_gap}"
        missing = f"{counted(self._missing, 'tick')} missing in {gaps}"
        answers, truth = self._name in _ANSWERS, self._name == "/truth"
        facts = (  # present or not, error or not, text
            (self._gaps, not answers, missing),  # an answer is optional
            (repeated, truth, f"{counted(repeated, 'repetition')}, the same to the bit"),
            (contradictions, True, f"{counted(contradictions, 'tick')} twice, and not the same"),
            (backwards, True, f"the stamp steps back {counted(backwards, 'time')}"),
            (resized, True, f"its arrays change their size {counted(resized, 'time')}"),
            (self._not_finite, True, f"not finite: {counted(self._not_finite, 'number')}"),
            (self._blinded, False, f"NaN under a fault: {counted(self._blinded, 'reading')}"),
        )
        words = [text for there, _, text in facts if there]
        ok = not any(there and wrong for there, wrong, _ in facts)
        if ok and not self._gaps:
            words.insert(0, f"{counted(self.messages - repeated, 'tick')} without a gap")
        return Finding(ok, self._name, "; ".join(words))


def _stamp_names(columns: Columns) -> tuple[str, str]:
    prefix = "header.stamp." if "header.stamp.sec" in columns else "stamp."
    return prefix + "sec", prefix + "nanosec"


def _same(a: np.ndarray, b: np.ndarray) -> bool:
    """Return whether two columns hold the same bits, or the same texts."""
    if a.dtype == object or b.dtype == object:
        return np.array_equal(a, b)
    return a.shape == b.shape and (a.tobytes() == b.tobytes() or a.tolist() == b.tolist())


def check_ticks(bag: BagReader) -> Iterator[Finding]:
    """Yield the findings on log times, on /clock, and on each topic of every tick."""
    refused = {(e.epoch, e.tick) for e in bag.overview.events if isinstance(e.what, SwitchRefused)}
    blind = BlindSensors(bag.overview.events)
    topics = {name: _Topic(name, refused, blind) for name in TICKED}
    rising, last = True, -1
    clock = _Clock()
    for block in bag.blocks([*TICKED, "/clock"], checked=False):
        if block.topic == "/clock":
            clock.add(block)
        else:
            topics[block.topic].add(block)
    for message in bag.messages():
        rising, last = rising and message.stamp > last, message.stamp
    yield Finding(rising, "log times", "unique and rising" if rising else "not rising")
    if clock.messages:
        resets = topics["/truth"].newest[0]
        detail = f"{clock.backwards} steps back" if clock.backwards else "never steps back"
        yield Finding(clock.backwards <= resets, "/clock", detail)
    for name, topic in topics.items():
        if topic.messages or name not in _ANSWERS:
            yield topic.finding()
    ended = bag.overview.metadata.get(RUN_RECORD, {})
    truth, events = topics["/truth"], bag.overview.events
    told = any(e.source == "plant" and isinstance(e.what, Started) for e in events)
    if told and truth.messages and ended and "recovered" not in ended:
        yield from check_ends(truth.first, truth.last, events)


class _Clock:
    def __init__(self) -> None:
        self.messages, self.backwards, self.last = 0, 0, -1

    def add(self, block: ColumnBlock) -> None:
        sec, nanosec = block.columns["clock.sec"], block.columns["clock.nanosec"]
        time = np.append(self.last, sec.astype(np.int64) * 10**9 + nanosec)
        self.backwards += int((np.diff(time) < 0).sum())
        self.messages += len(sec)
        self.last = int(time[-1])
