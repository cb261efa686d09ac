"""The log: writing, reading, checking, recovering and exporting MCAP bags."""
