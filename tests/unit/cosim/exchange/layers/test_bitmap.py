"""Bitmaps say the same to other readers: bits, first row, first column, polarity, resolution."""

from __future__ import annotations

import io
import struct

import numpy as np
import pytest
import tifffile
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from inkloop.exchange.layers import BITMAP_FORMATS
from inkloop.exchange.layers.bitmap import encode, stored_pitch
from support.bitmap_readers import png_chunks, stored_bits

PITCH = 263.256e-6
LETTER_F = np.array([list(row) for row in ("#####....", "#........", "####.....", "#........", "#........")]) == "#"
"""(rows, columns): no mirror image and no quarter turn of it is the same."""


def shown(content: bytes) -> np.ndarray:
    """(rows, columns), true where the picture is black."""
    with Image.open(io.BytesIO(content)) as picture:
        return np.asarray(picture.convert("L")) == 0


@pytest.mark.parametrize("form", BITMAP_FORMATS)
def test_a_letter_f_stands_upright_in_black(form: str) -> None:
    """`pattern[i, j]` is column i of row j; the top row of the letter is y = 0."""
    content = encode(LETTER_F.T, PITCH, form, "F")
    assert np.array_equal(stored_bits(content, form), LETTER_F)
    assert np.array_equal(shown(content), LETTER_F)


@pytest.mark.parametrize("form", BITMAP_FORMATS)
@pytest.mark.parametrize("shape", [(1, 1), (8, 3), (9, 2), (32, 5), (33, 40), (100, 64)])
@pytest.mark.parametrize("share", [0.0, 0.02, 0.5, 1.0])
def test_bits_survive(form: str, shape: tuple[int, int], share: float) -> None:
    droplets = np.random.default_rng(1).random(shape) < share
    content = encode(droplets, PITCH, form, "random")
    assert np.array_equal(stored_bits(content, form), droplets.T)
    assert np.array_equal(shown(content), droplets.T)


@given(st.floats(1e-6, 1e-3))
def test_resolution_of_tiff_gives_the_pitch(pitch: float) -> None:
    with tifffile.TiffFile(io.BytesIO(encode(LETTER_F.T, pitch, "tiff", "F"))) as file:
        page = file.pages.first
        assert page.resolutionunit == 3
        for per_cm in page.resolution:
            assert 0.01 / per_cm == pytest.approx(pitch, rel=1e-6, abs=0.0)
        text = page.description
    assert float(text.partition("pitch_um = ")[2]) == pytest.approx(pitch * 1e6, rel=1e-11, abs=0.0)


@given(st.floats(1e-6, 1e-3))
def test_resolution_of_png_and_bmp_is_the_nearest_whole_number_per_metre(pitch: float) -> None:
    per_metre = round(1.0 / pitch)
    chunks = png_chunks(encode(LETTER_F.T, pitch, "png", "F"))
    assert struct.unpack(">IIB", chunks[b"pHYs"]) == (per_metre, per_metre, 1)
    bmp = encode(LETTER_F.T, pitch, "bmp", "F")
    assert struct.unpack_from("<ii", bmp, 38) == (per_metre, per_metre)
    with Image.open(io.BytesIO(encode(LETTER_F.T, pitch, "png", "F"))) as picture:
        assert float(picture.info["pitch_um"]) == pytest.approx(pitch * 1e6, rel=1e-11, abs=0.0)
    for form in ("png", "bmp"):
        assert stored_pitch(pitch, form) == pytest.approx(1.0 / per_metre, rel=1e-15, abs=0.0)
        assert stored_pitch(pitch, form) == pytest.approx(pitch, rel=0.6 * pitch, abs=0.0)
