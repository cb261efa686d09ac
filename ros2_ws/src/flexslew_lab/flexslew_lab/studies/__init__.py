"""Studies: one trial flown thousands of times with varied values, and what that shows."""
