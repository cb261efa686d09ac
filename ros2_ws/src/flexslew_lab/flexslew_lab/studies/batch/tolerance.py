"""How far the metrics of a trial in a batch may be from those of the bench."""

TOLERANCE = 1e-9  # of a metric, or of one where it is smaller


def relative_difference(value: float | None, reference: float | None) -> float:
    """Return how far two values are apart, relative to the larger of the value and one."""
    if value is None or reference is None:
        return 0.0 if value is reference else 1e9
    return abs(value - reference) / max(1.0, abs(reference))
