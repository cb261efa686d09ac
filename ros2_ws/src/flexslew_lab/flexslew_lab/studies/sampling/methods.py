"""Where in the space of the varied values a study flies: six ways, each a function of the seed."""

import csv
from collections.abc import Callable, Sequence
from io import StringIO
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.stats import qmc

from flexslew_lab.studies.sampling.distributions import Distribution
from flexslew_plant.arrays import Matrix
from flexslew_plant.errors import BadInput
from flexslew_plant.given_file import given_text
from flexslew_plant.settings import section

MOST_FOR_SALTELLI = 64  # varied values
REPLICATES = 16  # independently randomised, where a file gives no number
_MINIMUM_POINTS = 4  # points of a replicate, before there are fewer of them
_STREAM = 0x5A3D  # spawn key of the samples; a trial's is its number alone


@section
class Sampling:
    """The `sampling` section."""

    method: Literal["random", "lhs", "sobol", "grid", "list", "saltelli"] = "random"
    n: Annotated[int, Field(ge=1)] | None = None  # samples; grid: levels a value; saltelli: rows
    replicates: Annotated[int, Field(ge=1)] | None = None  # of lhs, sobol and saltelli
    file: str | None = None  # of a list, CSV with the keys in its first row


class Samples(NamedTuple):
    """Points of the unit cube, or values as they are."""

    unit: Matrix  # (samples, values); empty for a grid and a list
    values: tuple[NDArray[np.float64], ...]  # by varied value, each (samples,); empty otherwise
    replicate: NDArray[np.int32]  # which of the independent parts each sample belongs to


class _Method(NamedTuple):
    draw: Callable[[Sampling, Sequence[Distribution], np.random.SeedSequence], Samples]
    default: int | None  # of n
    independent: bool  # whether bounds for independent samples hold
    replicated: bool  # whether randomised replicates give bounds


def _random(s: Sampling, spread: Sequence[Distribution], seed: np.random.SeedSequence) -> Samples:
    unit = np.random.default_rng(seed).random((_n(s), len(spread)))
    return Samples(unit, (), np.zeros(_n(s), dtype=np.int32))


def _lhs(s: Sampling, spread: Sequence[Distribution], seed: np.random.SeedSequence) -> Samples:
    """One Latin hypercube after the other; their sizes differ by one at most."""
    count = replicates_of(s)
    sizes = [len(part) for part in np.array_split(np.arange(_n(s)), count)]
    children = seed.spawn(count)
    parts = [
        qmc.LatinHypercube(len(spread), rng=np.random.default_rng(child)).random(size)
        for size, child in zip(sizes, children, strict=True)
    ]
    return Samples(np.concatenate(parts), (), np.repeat(np.arange(count, dtype=np.int32), sizes))


def _sobol(s: Sampling, spread: Sequence[Distribution], seed: np.random.SeedSequence) -> Samples:
    """Scrambled sequences in step: the first k replicates * 2^j samples are balanced too."""
    count = replicates_of(s)
    each = _n(s) // count
    parts = [
        qmc.Sobol(len(spread), rng=np.random.default_rng(child)).random(each)
        for child in seed.spawn(count)
    ]
    unit = np.stack(parts, axis=1).reshape(_n(s), len(spread))
    return Samples(unit, (), np.tile(np.arange(count, dtype=np.int32), each))


def _grid(s: Sampling, spread: Sequence[Distribution], seed: np.random.SeedSequence) -> Samples:
    axes = [distribution.levels(_n(s)) for distribution in spread]
    size = int(np.prod([len(axis) for axis in axes]))
    columns = [np.asarray(c).ravel() for c in np.meshgrid(*axes, indexing="ij")]
    return Samples(np.empty((size, 0)), tuple(columns), np.zeros(size, dtype=np.int32))


def _saltelli(s: Sampling, spread: Sequence[Distribution], seed: np.random.SeedSequence) -> Samples:
    """A, B, and for each value A with that column of B (Saltelli et al., 2010).

    The rows of each are those of one replicate after the other.
    """
    d, n, count = len(spread), _n(s), replicates_of(s)
    children = seed.spawn(count) if count > 1 else [seed]
    points = np.concatenate(
        [
            qmc.Sobol(2 * d, rng=np.random.default_rng(child)).random(n // count)
            for child in children
        ]
    )
    a, b = points[:, :d], points[:, d:]
    parts = [a, b]
    for j in range(d):
        mixed = a.copy()
        mixed[:, j] = b[:, j]
        parts.append(mixed)
    replicate = np.repeat(np.arange(count, dtype=np.int32), n // count)
    return Samples(np.concatenate(parts), (), np.tile(replicate, d + 2))


def _list(s: Sampling, spread: Sequence[Distribution], seed: np.random.SeedSequence) -> Samples:
    raise AssertionError("a list is read, not drawn")


METHODS: dict[str, _Method] = {
    "random": _Method(_random, 1000, True, False),
    "lhs": _Method(_lhs, 1000, False, True),
    "sobol": _Method(_sobol, 1024, False, True),
    "grid": _Method(_grid, 5, False, False),
    "list": _Method(_list, None, False, False),
    "saltelli": _Method(_saltelli, 256, False, False),
}


def draw_samples(s: Sampling, spread: Sequence[Distribution], seed: int) -> Samples:
    """Return the samples of a study; the same seed gives the same ones everywhere."""
    root = np.random.SeedSequence(seed, spawn_key=(_STREAM,))
    return METHODS[s.method].draw(s, spread, root)


def replicates_of(s: Sampling) -> int:
    """Return how many independently randomised parts a sample has."""
    if not METHODS[s.method].replicated:
        return s.replicates or 1
    return s.replicates or max(min(REPLICATES, _n(s) // _MINIMUM_POINTS), 1)


def check_sampling(s: Sampling, values: int, place: str) -> None:
    """Check n, replicates and file against the method.

    Args:
        s: the section.
        values: how many values are varied.
        place: file and key, for messages.

    Raises:
        BadInput: what cannot be drawn, with sizes that can.
    """
    if s.method == "list":
        for key, given in (("n", s.n), ("replicates", s.replicates)):
            if given is not None:
                raise BadInput("a list has its own length", key=f"{place}.{key}", value=given)
        if s.file is None:
            raise BadInput(f"{place}.file: is missing; name the CSV file of the list")
        return
    if s.file is not None:
        raise BadInput("only method list reads a file", key=f"{place}.file", value=s.file)
    n = _n(s)
    if s.method in ("sobol", "saltelli") and n & (n - 1):
        below = 1 << (n.bit_length() - 1)
        raise BadInput(
            f"{s.method} is balanced for powers of two only, such as {below} and {2 * below}",
            key=f"{place}.n",
            value=n,
        )
    if s.method == "saltelli" and values > MOST_FOR_SALTELLI:
        raise BadInput(
            f"{place}.method: saltelli is not allowed for {values} varied values: "
            f"at most {MOST_FOR_SALTELLI}"
        )
    if s.replicates is not None:
        _check_replicates(s, s.replicates, place)


def _check_replicates(s: Sampling, count: int, place: str) -> None:
    if s.method not in ("lhs", "sobol", "saltelli"):
        words = "only lhs, sobol and saltelli have some"
        raise BadInput(words, key=f"{place}.replicates", value=count)
    if count > _n(s):
        raise BadInput(f"at most n, {_n(s)}", key=f"{place}.replicates", value=count)
    if s.method != "lhs" and count & (count - 1):
        raise BadInput(
            "a power of two, so that each part is balanced", key=f"{place}.replicates", value=count
        )


def list_of(path: Path, place: str) -> tuple[tuple[str, ...], tuple[NDArray[np.float64], ...]]:
    """Return the keys and the columns of a CSV file.

    Raises:
        BadInput: it cannot be read, a row has another length, or an entry is no finite number.
    """
    try:
        rows = [row for row in csv.reader(StringIO(given_text(path), newline="")) if row]
    except (BadInput, csv.Error) as error:
        raise BadInput(str(error), place) from None
    if len(rows) < 2:
        raise BadInput(f"{path}: holds no samples; give a row of keys and rows of numbers", place)
    keys = tuple(key.strip() for key in rows[0])
    columns: list[list[float]] = [[] for _ in keys]
    for number, row in enumerate(rows[1:], start=2):
        if len(row) != len(keys):
            raise BadInput(f"{path}: row {number} has {len(row)} of {len(keys)} entries", place)
        for key, entry, column in zip(keys, row, columns, strict=True):
            try:
                value = float(entry)
            except ValueError:
                value = np.nan
            if not np.isfinite(value):
                raise BadInput(f"{path}: row {number}: {key}: {entry!r} is no number", place)
            column.append(value)
    return keys, tuple(np.array(column) for column in columns)


def _n(s: Sampling) -> int:
    n = s.n if s.n is not None else METHODS[s.method].default
    assert n is not None
    return n
