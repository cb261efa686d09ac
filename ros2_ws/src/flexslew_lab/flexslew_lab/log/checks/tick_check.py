"""Are the ticks of a log whole: every one, in order, and about each of them one word only?"""

from collections.abc import Container, Iterator, Mapping

import numpy as np

from flexslew_lab.log.bag_columns import ColumnBlock
from flexslew_lab.log.bag_layout import RUN_RECORD
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.checks.blind_sensors import BlindSensors
from flexslew_lab.log.checks.end_check import check_ends
from flexslew_lab.log.checks.finding import Finding as Finding
from flexslew_plant.counted import count_text
from flexslew_plant.events import Started, SwitchRejected

TICK_TOPICS = ("/truth", "/measurement", "/effort_command", "/controller_state")
_ANSWER_TOPICS = ("/effort_command", "/controller_state")
_TERMS = ("term_names", "terms")  # of which a law has one more while it takes over

Key = tuple[int, int]  # epoch and tick
Columns = Mapping[str, np.ndarray]


class _Sender:
    """All messages of one sender about each tick, block after block.

    A question is repeated until it is answered, and each repetition gets the same answer; a
    different message about the same tick is an error.

    Args:
        rejected_keys: epochs and ticks at which a refused switch returned the question to another.
    """

    def __init__(self, rejected_keys: Container[Key]) -> None:
        self._rejected_keys = rejected_keys
        self.repeated, self.changed_repeats, self.backward_steps, self.size_changes = 0, 0, 0, 0
        self._last: Columns = {}  # its last message

    def add(self, columns: Columns) -> None:
        """Take the next messages."""
        before = self._last or {name: column[:1] for name, column in columns.items()}
        self.size_changes += any(
            column.shape[1:] != before[name].shape[1:]
            for name, column in columns.items()
            if name not in _TERMS
        )
        tick, epoch, sec, nanosec = (
            np.append(before[name], columns[name]).astype(np.int64)
            for name in ("tick", "epoch", *_stamp_names(columns))
        )
        same = np.diff(epoch) == 0
        self.backward_steps += int((same & (np.diff(sec * 10**9 + nanosec) < 0)).sum())
        for k in np.flatnonzero(same & (np.diff(tick) == 0)).tolist():
            if k or self._last:
                previous = {n: c[k - 1 : k] for n, c in columns.items()} if k else before
                self._check_repeat(previous, {n: c[k : k + 1] for n, c in columns.items()})
        self._last = {name: column[-1:].copy() for name, column in columns.items()}

    def _check_repeat(self, previous: Columns, later: Columns) -> None:
        """Take two messages about one tick."""
        other = {name for name, value in later.items() if not _same(previous[name], value)}
        key = int(later["epoch"][0]), int(later["tick"][0])
        self.repeated += not other
        self.changed_repeats += bool(other) and (
            other != {"controller"} or key not in self._rejected_keys
        )


class _Topic:
    """A topic of every tick, block after block.

    Args:
        name: of the topic.
        rejected_keys: see _Sender.
        blind: which readings may be NaN.
    """

    def __init__(self, name: str, rejected_keys: Container[Key], blind: BlindSensors) -> None:
        self._name, self._rejected_keys, self._blind = name, rejected_keys, blind
        self._senders: dict[str, _Sender] = {}
        self.messages, self._gaps, self._missing = 0, 0, 0
        self._not_finite, self._fault_nan_count = 0, 0
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
        self._count_missing(columns["epoch"].astype(np.int64), columns["tick"].astype(np.int64))
        # a block has one layout, and with it one text; late answers come among those of others
        name = str(columns["controller"][0]) if self._name in _ANSWER_TOPICS else ""
        self._senders.setdefault(name, _Sender(self._rejected_keys)).add(columns)

    def _find(self, name: str, columns: Columns) -> None:
        """Count the numbers of a column that are not finite, with a reason and without."""
        wrong = ~np.isfinite(columns[name])
        blind = np.zeros(len(wrong), dtype=bool)
        if self._name == "/measurement":
            blind = self._blind.at(name, columns["epoch"], columns["tick"])
        self._fault_nan_count += int(wrong[blind].sum())
        self._not_finite += int(wrong[~blind].sum())

    def _count_missing(self, epoch: np.ndarray, tick: np.ndarray) -> None:
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
        changed_repeats = sum(sender.changed_repeats for sender in senders)
        backward_steps = sum(sender.backward_steps for sender in senders)
        size_changes = sum(sender.size_changes for sender in senders)
        gaps = f"{count_text(self._gaps, 'gap')}, {self._first_gap}"
        missing = f"{count_text(self._missing, 'tick')} missing in {gaps}"
        is_answer, truth = self._name in _ANSWER_TOPICS, self._name == "/truth"
        facts = (  # present or not, error or not, text
            (self._gaps, not is_answer, missing),  # an answer is optional
            (repeated, truth, f"{count_text(repeated, 'repetition')}, the same to the bit"),
            (
                changed_repeats,
                True,
                f"{count_text(changed_repeats, 'tick')} twice, and not the same",
            ),
            (backward_steps, True, f"the stamp steps back {count_text(backward_steps, 'time')}"),
            (
                size_changes,
                True,
                f"its arrays change their size {count_text(size_changes, 'time')}",
            ),
            (self._not_finite, True, f"not finite: {count_text(self._not_finite, 'number')}"),
            (
                self._fault_nan_count,
                False,
                f"NaN under a fault: {count_text(self._fault_nan_count, 'reading')}",
            ),
        )
        words = [text for present, _, text in facts if present]
        ok = not any(present and wrong for present, wrong, _ in facts)
        if ok and not self._gaps:
            words.insert(0, f"{count_text(self.messages - repeated, 'tick')} without a gap")
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
    rejected_keys = {
        (e.epoch, e.tick) for e in bag.overview.events if isinstance(e.what, SwitchRejected)
    }
    blind = BlindSensors(bag.overview.events)
    topics = {name: _Topic(name, rejected_keys, blind) for name in TICK_TOPICS}
    increasing, last = True, -1
    clock = _Clock()
    for block in bag.blocks([*TICK_TOPICS, "/clock"], checked=False):
        if block.topic == "/clock":
            clock.add(block)
        else:
            topics[block.topic].add(block)
    for message in bag.messages():
        increasing, last = increasing and message.stamp > last, message.stamp
    yield Finding(increasing, "log times", "unique and rising" if increasing else "not rising")
    if clock.messages:
        resets = topics["/truth"].newest[0]
        detail = (
            f"{clock.backward_steps} steps back" if clock.backward_steps else "never steps back"
        )
        yield Finding(clock.backward_steps <= resets, "/clock", detail)
    for name, topic in topics.items():
        if topic.messages or name not in _ANSWER_TOPICS:
            yield topic.finding()
    run_record = bag.overview.metadata.get(RUN_RECORD, {})
    truth, events = topics["/truth"], bag.overview.events
    has_started = any(e.source == "plant" and isinstance(e.what, Started) for e in events)
    if has_started and truth.messages and run_record and "recovered" not in run_record:
        yield from check_ends(truth.first, truth.last, events)


class _Clock:
    def __init__(self) -> None:
        self.messages, self.backward_steps, self.last = 0, 0, -1

    def add(self, block: ColumnBlock) -> None:
        sec, nanosec = block.columns["clock.sec"], block.columns["clock.nanosec"]
        time = np.append(self.last, sec.astype(np.int64) * 10**9 + nanosec)
        self.backward_steps += int((np.diff(time) < 0).sum())
        self.messages += len(sec)
        self.last = int(time[-1])
