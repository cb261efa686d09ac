"""A trial as it is flown, in this process or over ROS in several, with all that it leaves.

Offers: controller_process, domain, flight_log, in_process, metrics_observer, pool, run_trial,
tick.
"""
