"""Slews with the least worst vibration over an ensemble of models, by convex programs."""
