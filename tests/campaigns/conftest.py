"""Campaigns: promises of docs/security.md and docs/limits.md, attacked at random.

`--cases 1000 --seed 7` draws a thousand cases from seed 7 on; ten from seed 1 on are drawn in CI.
"""
