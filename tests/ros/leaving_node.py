"""A node that has nothing to do and says that all is well."""


def main() -> None:
    raise SystemExit(0)
