"""Worst case over a box of uncertain parameters: a certificate, and the loop that breaks it.

Offers: bounds, flight, parameters, situation, tables, uncertain_model, worst_case.
"""
