"""Identification of a controller at rest, by its answers to possible readings."""
