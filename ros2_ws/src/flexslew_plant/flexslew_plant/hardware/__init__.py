"""Motors with friction, the drive, the sensors, and what disturbs the joints.

Offers: actuator, disturbances, drive, friction, motor_step, plausibility, sensor_step,
sensors, spin_limits.
"""
