"""Estimators: from measurements to an estimate of the state."""
