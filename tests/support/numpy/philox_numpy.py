"""Philox 4x32-10 (Salmon et al. 2011) over arrays of counters, written from the paper with Python's whole numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

WORD = 0xFFFFFFFF


def philox(key: tuple[int, int], counter: tuple[int, int, int, int]) -> tuple[int, int, int, int]:
    """Four 32-bit words."""
    a, b, c, d = counter
    for bump in range(10):
        k0 = (key[0] + bump * 0x9E3779B9) & WORD
        k1 = (key[1] + bump * 0xBB67AE85) & WORD
        first, second = a * 0xD2511F53, c * 0xCD9E8D57
        a, b, c, d = (second >> 32) ^ b ^ k0, second & WORD, (first >> 32) ^ d ^ k1, first & WORD
    return a, b, c, d


def uniforms(seed: int, stream: int, cell: int, number: int) -> tuple[float, float]:
    """Two uniform numbers on [0, 1) of 53 bits."""
    words = philox((seed, stream), (cell & WORD, cell >> 32, number, 0))
    return (words[0] << 21 | words[1] >> 11) / 2**53, (words[2] << 21 | words[3] >> 11) / 2**53


def uniform_map(seed: int, stream: int, shape: tuple[int, int], number: int) -> Any:
    """The first uniform number of every cell."""
    return np.array([uniforms(seed, stream, cell, number)[0] for cell in range(shape[0] * shape[1])]).reshape(shape)


def normal(seed: int, stream: int, cell: int, number: int) -> float:
    """Standard normal number by Box and Muller, cosine branch."""
    u1, u2 = uniforms(seed, stream, cell, number)
    return float(np.sqrt(-2.0 * np.log(1.0 - u1)) * np.cos(2.0 * np.pi * u2))


def normal_map(seed: int, stream: int, shape: tuple[int, int], number: int) -> Any:
    """A standard normal number for every cell."""
    return np.array([normal(seed, stream, cell, number) for cell in range(shape[0] * shape[1])]).reshape(shape)
