"""Motors with friction, the drive, the sensors, and what disturbs the joints."""
