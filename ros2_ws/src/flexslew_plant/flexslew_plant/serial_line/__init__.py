"""Messages over a serial line: frames with a checksum, and questions that are repeated.

Offers: exchange, port.
"""
