"""The version of the bench; pyproject.toml says the same."""

VERSION = "0.1.0"
