"""What is compiled for every testbed: forward dynamics, integration, and many trials at once."""
