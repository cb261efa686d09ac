"""Operators who do anything to a bench at any moment, and what it must make of that.

Each file holds what is done in one field, as a table of acts with how often each is drawn.
"""
