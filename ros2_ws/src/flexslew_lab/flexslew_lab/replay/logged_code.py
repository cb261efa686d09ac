"""Code of the user's own that a log names: what it was when it was recorded, what it is here."""

from collections.abc import Iterator
from contextlib import contextmanager

from flexslew_control.controllers import LAW_HASH
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.messages.logged_text import logged_json, logged_yaml
from flexslew_lab.trial.own_code import HASH_KEY
from flexslew_plant.own_code import Untrusted, code_hash


@contextmanager
def reading(bag: BagReader) -> Iterator[None]:
    """Add to errors of refused code in the block whether it is the code of the recorded run.

    Raises:
        Untrusted: inside of the block, with the file, its hash, and whether it is the recorded one.
    """
    try:
        yield
    except Untrusted as error:
        recorded = logged_digests(bag).get(error.name, "")
        if not recorded:
            words = "the log holds no hash of it"
        elif recorded == code_hash(error.name):
            words = "it is the file that was recorded"
        else:
            words = f"it is NOT the file that was recorded, whose SHA-256 is {recorded}"
        raise Untrusted(f"{error}; {words}", error.name) from None


def logged_digests(bag: BagReader) -> dict[str, str]:
    """Return the SHA-256 of every file that ran in the recorded run, by the name of its class."""
    found = logged_json(bag.metadata.get(HASH_KEY, ""), f"{bag.path}: {HASH_KEY}")
    digests = {str(name): str(digest) for name, digest in found.items()}
    for name, status in bag.overview.statuses.items():
        settings = logged_yaml(status.settings, f"{bag.path}: controllers.{name}")
        if LAW_HASH in settings:
            digests[status.law] = str(settings[LAW_HASH])
    return digests


def changed_code(bag: BagReader) -> dict[str, tuple[str, str]]:
    """Return the SHA-256 there and here (empty: no file) of code that is another one, by name."""
    pairs = {name: (digest, code_hash(name)) for name, digest in logged_digests(bag).items()}
    return {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}
