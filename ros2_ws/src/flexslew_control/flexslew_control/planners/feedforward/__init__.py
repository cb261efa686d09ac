"""Feedforward from an optimisation of the terminal error."""
