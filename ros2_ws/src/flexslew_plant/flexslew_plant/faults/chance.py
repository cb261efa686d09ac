"""Chance of a fault, tick by tick: as NumPy draws it, and for many ticks at once."""

from collections.abc import Sequence
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from flexslew_plant.arrays import Vector, called, compiled

Words = NDArray[np.uint64]

_WORD = np.uint64(0xFFFFFFFF)  # numbers of 32 bits are kept in 64
_HALF, _ONE = np.uint64(32), np.uint64(1)
# NumPy's SeedSequence
_INIT_A, _MULT_A = np.uint64(0x43B0D7E5), np.uint64(0x931E8875)
_INIT_B, _MULT_B = np.uint64(0x8B51F9DD), np.uint64(0x58F38DED)
_LEFT, _RIGHT, _SHIFT = np.uint64(0xCA01F9DD), np.uint64(0x4973F715), np.uint64(16)
# NumPy's PCG64
_HIGH, _LOW = np.uint64(0x2360ED051FC65DA4), np.uint64(0x4385DF649FCCF645)
_TOP, _ROTATION_BITS, _LOST = np.uint64(58), np.uint64(64), np.uint64(11)


def key_of(seed: int, epoch: int, start: int, kind: str, fault_seed: int) -> tuple[int, ...]:
    """Return what the chance of a fault depends on, besides the tick.

    Args:
        seed: of the trial.
        epoch: counts resets.
        start: first tick of the fault.
        kind: of the fault.
        fault_seed: seed of the fault.
    """
    return seed, epoch, start, crc32(kind.encode()), fault_seed


def random_number(key: tuple[int, ...], tick: int) -> float:
    """Return the number in [0, 1) that is drawn at a tick."""
    return float(np.random.default_rng((*key, tick)).random())


def random_numbers(key: tuple[int, ...], first: int, last: int) -> Vector:
    """Return what `drawn` does at ticks from `first` to before `last`, below 2^32, bit for bit."""
    return _random_numbers(_words(key), first, last)


def _words(numbers: Sequence[int]) -> Words:
    """Return numbers as words of 32 bits, the low ones first, as a SeedSequence reads them."""
    words: list[int] = []
    for number in numbers:
        words.append(number & 0xFFFFFFFF)
        while number := number >> 32:
            words.append(number & 0xFFFFFFFF)
    return np.array(words, dtype=np.uint64)


@called
def _mixed(x: np.uint64, y: np.uint64) -> np.uint64:
    mixed = (_LEFT * x - _RIGHT * y) & _WORD
    return mixed ^ (mixed >> _SHIFT)


@called
def _hash(word: np.uint64, constant: np.uint64, factor: np.uint64) -> tuple[np.uint64, np.uint64]:
    """Return the hash of a word, and the constant for the next one."""
    after = (constant * factor) & _WORD
    found = ((word ^ constant) * after) & _WORD
    return found ^ (found >> _SHIFT), after


@called
def _product(high: np.uint64, low: np.uint64) -> tuple[np.uint64, np.uint64]:
    """Return the upper and lower half of a state of 128 bits times the factor of PCG64."""
    a, b, c, d = low >> _HALF, low & _WORD, _LOW >> _HALF, _LOW & _WORD
    inner, outer = a * d, b * c
    middle = (b * d >> _HALF) + (inner & _WORD) + (outer & _WORD)
    carry = a * c + (inner >> _HALF) + (outer >> _HALF) + (middle >> _HALF)
    return high * _LOW + low * _HIGH + carry, low * _LOW


@called
def _sum(
    high: np.uint64, low: np.uint64, more_high: np.uint64, more_low: np.uint64
) -> tuple[np.uint64, np.uint64]:
    after = low + more_low
    return high + more_high + (_ONE if after < low else np.uint64(0)), after


@called
def _first_number(seeds: Words) -> float:
    """Return the first number of a PCG64 from the eight words of its SeedSequence."""
    state = np.empty(4, np.uint64)
    for i in range(4):
        state[i] = seeds[2 * i] | (seeds[2 * i + 1] << _HALF)
    odd = (state[2] << _ONE) | (state[3] >> np.uint64(63)), (state[3] << _ONE) | _ONE
    high, low = _sum(odd[0], odd[1], state[0], state[1])
    for _ in range(2):
        high, low = _product(high, low)
        high, low = _sum(high, low, odd[0], odd[1])
    mixed, rotation = high ^ low, high >> _TOP
    if rotation > 0:
        mixed = (mixed >> rotation) | (mixed << (_ROTATION_BITS - rotation))
    return float(mixed >> _LOST) * 2.0**-53


@compiled
def _random_numbers(words: Words, first: int, last: int) -> Vector:
    found = np.empty(max(last - first, 0))
    count = words.size + 1
    entropy = np.zeros(max(count, 4), np.uint64)
    entropy[: words.size] = words
    pool, seeds = np.empty(4, np.uint64), np.empty(8, np.uint64)
    for k in range(found.size):
        entropy[words.size] = np.uint64(first + k)
        constant = _INIT_A
        for i in range(4):
            pool[i], constant = _hash(entropy[i], constant, _MULT_A)
        for i in range(4):
            for j in range(4):
                if i != j:
                    one, constant = _hash(pool[i], constant, _MULT_A)
                    pool[j] = _mixed(pool[j], one)
        for i in range(4, count):
            for j in range(4):
                one, constant = _hash(entropy[i], constant, _MULT_A)
                pool[j] = _mixed(pool[j], one)
        constant = _INIT_B
        for i in range(8):
            seeds[i], constant = _hash(pool[i % 4], constant, _MULT_B)
        found[k] = _first_number(seeds)
    return found
