"""Time-optimal and robust time-optimal slews."""
