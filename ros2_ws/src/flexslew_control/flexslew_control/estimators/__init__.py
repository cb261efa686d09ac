"""Estimators: from measurements to an estimate of the state.

Offers: attitude_estimator, kalman, kalman_tick, monitor, small_motion_observer,
turning_filter.
"""
