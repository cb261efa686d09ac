"""Testbeds that are black boxes: a plant that flies and has no equations here.

Offers: model.
"""
