"""Estimators: from measurements to an estimate of the state.

Offers: attitude_estimator, attitude_tick, flexible_attitude_tick, gained_filter,
instrument_readings, kalman, kalman_tick, monitor, small_motion_observer, rotation_filter.
"""
