"""Numbers of things, in words."""


def count_text(number: int, one: str, many: str = "") -> str:
    """Return a number with its noun: 1 mode, 3 modes, 0 entries.

    Args:
        number: of them.
        one: the noun.
        many: of several; empty: one with an s.
    """
    return f"{number} {one if number == 1 else many or one + 's'}"
