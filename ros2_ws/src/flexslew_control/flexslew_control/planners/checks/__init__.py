"""Checks of slews and plans, and the remedies that a refusal names."""
