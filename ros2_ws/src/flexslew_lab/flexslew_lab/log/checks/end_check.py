"""Check the start and the end of each epoch in a log against the plant's events."""

from collections.abc import Iterator, Mapping, Sequence

from flexslew_lab.log.checks.finding import Finding
from flexslew_plant.counted import count_text
from flexslew_plant.events import (
    Event,
    PlantLost,
    RunFinished,
    RunStopped,
    Started,
    StateLost,
    WasReset,
)

_ENDS = (RunFinished, RunStopped, StateLost, PlantLost)


def check_ends(
    first: Mapping[int, int], last: Mapping[int, int], events: Sequence[Event]
) -> Iterator[Finding]:
    """Yield what is missing of the truth before its first tick and behind its last one.

    Args:
        first: the first tick of each epoch in the log.
        last: the last one.
        events: of the log.
    """
    late = {epoch: tick for epoch, tick in first.items() if tick > 0}
    missing = sum(late.values())
    where = ", ".join(f"epoch {e} begins at tick {t}" for e, t in sorted(late.items()))
    words = f"{count_text(missing, 'tick')} missing: {where}" if late else "from tick 0 on"
    yield Finding(not late, "start of the ticks", words)
    ends = _ends(events)
    newest = max(last, default=0)
    short = {e: end - last.get(e, -1) for e, end in ends.items() if end > last.get(e, -1)}
    wrong = []
    if short:
        missing = sum(short.values())
        where = ", ".join(f"epoch {e} was flown to tick {ends[e]}" for e in sorted(short))
        wrong.append(f"{count_text(missing, 'tick')} missing: {where}")
    if newest not in ends:
        wrong.append(
            f"the plant's final event is missing: it may have run on from tick {last[newest]}"
        )
    yield Finding(not wrong, "end of the ticks", "; ".join(wrong) or "as the plant reports")


def _ends(events: Sequence[Event]) -> dict[int, int]:
    """Return the last tick of each started epoch with an end in the plant's events."""
    ends = {}
    plant_events = [event for event in events if event.source == "plant"]
    started = {event.epoch for event in plant_events if isinstance(event.what, Started)}
    for event in plant_events:
        if isinstance(event.what, _ENDS):
            ends[event.epoch] = event.tick
        elif isinstance(event.what, WasReset) and event.what.from_tick is not None:
            before, tick = event.epoch - 1, event.what.from_tick
            ends |= {before: tick} if tick > 0 or before in started else {}
    return ends
