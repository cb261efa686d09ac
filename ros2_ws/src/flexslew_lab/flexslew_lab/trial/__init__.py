"""Trials: the file, its flight in process or over ROS 2, its processes.

Offers: angles, assumed_rest, outputs, overrides, own_code, schema, sources, trial.
"""
