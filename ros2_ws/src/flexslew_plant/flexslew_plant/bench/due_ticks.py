"""Refusals, in the same words everywhere, of requests for ticks that are over or never come."""

from flexslew_plant.refusal import Cause, Refusal


def past(tick: int, now: int, period: float) -> Refusal | None:
    """Return why nothing can happen at a tick any more, or None; 0 stands for the next.

    Args:
        tick: requested tick.
        now: present tick of the bench.
        period: duration of a tick [s].
    """
    if tick == 0 or tick >= now:
        return None
    at = f"{tick * period:g} s" if tick > 0 else "that time"
    return Refusal(f"{at} is past: the bench is at {now * period:g} s", cause=Cause.PAST)


def too_late(tick: int, last_tick: int | None) -> Refusal | None:
    """Return why nothing can begin at a tick, if the run is over by then.

    Args:
        tick: requested tick.
        last_tick: last tick of the run; None: it runs until it is stopped.
    """
    if last_tick is None or tick < last_tick:
        return None
    words = f"tick {tick} is too late: the run ends at tick {last_tick}"
    return Refusal(words, cause=Cause.RUN_OVER)


def requested_tick(at: float, period: float, tick: int) -> int:
    """Return the tick of a request: 0 for the next one, negative for one that is long past.

    Args:
        at: simulated time [s]; zero stands for the next tick.
        period: length of a tick [s].
        tick: current tick of the bench.
    """
    nearest = round(at / period)
    return -1 if at and nearest == 0 < tick else nearest
