"""What a study shows: bounds, sensitivities, when to stop, the summary and its page."""
