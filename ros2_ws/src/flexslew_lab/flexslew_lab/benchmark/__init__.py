"""Frozen problems on which controllers are compared: tasks, entries, scores and result files.

Offers: baselines, entry, flight, leaderboard, result, score, task.
"""
