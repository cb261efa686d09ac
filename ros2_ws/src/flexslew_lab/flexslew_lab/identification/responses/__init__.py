"""Frequency responses, the modes fitted to them alone, and universal files of both."""
