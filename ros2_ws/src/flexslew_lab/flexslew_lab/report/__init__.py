"""Metrics, figures, reports and comparisons of runs."""
