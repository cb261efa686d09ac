"""Pointing budgets: performance errors by error source, from the linear loop of a trial.

Offers: page, parts, pointing_budget, prove, requirements, tables.
"""
