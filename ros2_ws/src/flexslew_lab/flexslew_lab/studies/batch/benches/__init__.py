"""What benches do in addition to the law: sensors, drives, faults, disturbances."""
