"""Campaigns: promises of docs/security.md and docs/limits.md, attacked at random.

`--cases 1000 --seed 7` draws a thousand cases from seed 7 on. Without it the default run draws the
first case of seed 1, and `--all` ten.
"""
