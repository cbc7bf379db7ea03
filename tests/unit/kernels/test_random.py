"""The counter-based generator against its publication."""

from __future__ import annotations

import ctypes

import pytest

from support import compiled
from support.numpy.philox_numpy import normal, philox, uniforms
from support.places import ROOT

pytestmark = pytest.mark.compiled
COMMON = ROOT / "fmus" / "common"

# Salmon, Moraes, Dror, Shaw: Random123, known-answer vectors of philox4x32 with 10 rounds: counter, key, words
KNOWN_ANSWERS = [
    ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
    ((0xFFFFFFFF,) * 4, (0xFFFFFFFF,) * 2, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
    (
        (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
        (0xA4093822, 0x299F31D0),
        (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
    ),
]


@pytest.fixture(scope="module")
def library() -> ctypes.CDLL:
    loaded = compiled.library("random.so", [COMMON / "random.c"], ("-std=c11", "-O2"))
    for name in ("random_uniform", "random_normal"):
        getattr(loaded, name).restype = ctypes.c_double
        getattr(loaded, name).argtypes = [ctypes.c_int32, ctypes.c_int, ctypes.c_uint64, ctypes.c_int32]
    return loaded


@pytest.mark.parametrize(("counter", "key", "words"), KNOWN_ANSWERS)
def test_generator_gives_the_published_words(library, counter, key, words) -> None:
    found = (ctypes.c_uint32 * 4)()
    library.philox((ctypes.c_uint32 * 2)(*key), (ctypes.c_uint32 * 4)(*counter), found)
    assert tuple(found) == words
    assert philox(key, counter) == words


@pytest.mark.parametrize("cell", [0, 1, 2**32 - 1, 2**32, 2**40 + 7])
def test_a_number_depends_on_its_place_alone(library, cell) -> None:
    places = [(seed, stream, cell, number) for seed in (0, 2**31 - 1) for stream in (1, 7) for number in (0, 53)]
    for place in reversed(places):
        assert library.random_uniform(*place) == uniforms(*place)[0]
        assert library.random_normal(*place) == pytest.approx(normal(*place), rel=1e-12, abs=1e-15)
    assert len({uniforms(*place)[0] for place in places}) == len(places)
