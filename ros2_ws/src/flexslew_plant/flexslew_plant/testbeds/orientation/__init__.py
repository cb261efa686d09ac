"""Orientations: quaternions, and attitudes as the positions of joints."""
