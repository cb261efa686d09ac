"""A run of the bench against the wall clock: its states, pace, and participants."""
