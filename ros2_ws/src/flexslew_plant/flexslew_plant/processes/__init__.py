"""Processes beside each other: locks, identities, interrupts.

Offers: atomic, file_lock, interrupted, process_identity.
"""
