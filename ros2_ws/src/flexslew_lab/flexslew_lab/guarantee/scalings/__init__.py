"""Certificates by scalings D and G, each on an arc of the frequencies."""
