"""A linear plant x' = A x + B u, y = C x of another program as a testbed.

Offers: testbed.
"""
