"""What a key of a section may hold, and what a person reads where it is refused.

Offers: refused_keys, settings_fields, units.
"""
