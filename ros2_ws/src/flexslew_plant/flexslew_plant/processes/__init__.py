"""Processes on one machine: locks, identities, interrupts.

Offers: atomic, file_lock, interrupted, private_folder, process_identity.
"""
