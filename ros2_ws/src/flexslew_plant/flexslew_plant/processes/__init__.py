"""Processes on one machine: locks, identities, interrupts.

Offers: atomic, command_words, file_lock, interrupted, private_folder, process_identity.
"""
