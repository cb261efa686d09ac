"""How far the metrics of a trial in a lane may be from those of the bench."""

TOLERANCE = 1e-9  # of a metric, or of one where it is smaller


def apart(ours: float | None, theirs: float | None) -> float:
    """Return how far two values are apart, relative to the larger of the value and one."""
    if ours is None or theirs is None:
        return 0.0 if ours is theirs else 1e9
    return abs(ours - theirs) / max(1.0, abs(theirs))
