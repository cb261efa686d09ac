"""The version of the bench, as in pyproject.toml."""

VERSION = "0.1.0"
