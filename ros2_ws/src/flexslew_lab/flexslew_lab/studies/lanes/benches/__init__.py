"""What benches do beside the law: sensors, drives, faults, pushes from outside."""
