"""Ticks for which something is asked and that are over, or do not come: why, in the same words."""

from flexslew_plant.refusal import Cause, Refusal


def past(tick: int, now: int, period: float) -> Refusal | None:
    """Return why nothing can happen at a tick any more, or None; 0 stands for the next.

    Args:
        tick: that is asked for.
        now: at which the bench is.
        period: of one tick [s].
    """
    if tick == 0 or tick >= now:
        return None
    at = f"{tick * period:g} s" if tick > 0 else "that time"
    return Refusal(f"{at} is past: the bench is at {now * period:g} s", cause=Cause.PAST)


def too_late(tick: int, last_tick: int | None) -> Refusal | None:
    """Return why nothing can begin at a tick, if the run is over by then.

    Args:
        tick: that is asked for.
        last_tick: of the run; None: somebody stops it.
    """
    if last_tick is None or tick < last_tick:
        return None
    words = f"tick {tick} is too late: the run ends at tick {last_tick}"
    return Refusal(words, cause=Cause.RUN_OVER)
