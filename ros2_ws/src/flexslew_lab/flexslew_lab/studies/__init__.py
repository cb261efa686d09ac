"""Studies: one trial flown thousands of times with other numbers, and what that shows."""
