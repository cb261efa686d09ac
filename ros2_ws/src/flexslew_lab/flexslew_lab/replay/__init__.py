"""Replay of a log: onto the topics, through the bench again, into a controller."""
