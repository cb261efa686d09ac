"""Estimators: from measurements to an estimate of the state.

Offers: attitude_estimator, attitude_tick, flexible_attitude_tick, gained_filter,
instrument_readings, kalman, monitor, prediction, small_motion_observer, rotation_filter.
"""
