"""The state at the start of a run: initial positions and motion of one testbed or of many."""
