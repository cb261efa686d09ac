"""Gains of a law, searched for over an ensemble of benches.

Offers: ensemble, page, search.
"""
