"""Testbeds of masses and springs: floating, or with parameters that change with time."""
