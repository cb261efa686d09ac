"""Pointing budgets: performance errors by error source, from the linear loop of a trial.

Offers: budget, page, parts, pointing_budget, prove, requirements, tables.
"""
