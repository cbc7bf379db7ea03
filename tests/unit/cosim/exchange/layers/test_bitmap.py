"""Bitmaps say the same to other readers: bits, first row, first column, polarity, resolution.

TIFF is read by tifffile with the decoder of imagecodecs, PNG and BMP byte by byte as their specifications have them.
"""

from __future__ import annotations

import io
import struct
import zlib

import numpy as np
import pytest
import tifffile
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from inkloop.exchange.layers import BITMAP_FORMATS
from inkloop.exchange.layers.bitmap import encode, stored_pitch

PITCH = 263.256e-6
LETTER_F = np.array([list(row) for row in ("#####....", "#........", "####.....", "#........", "#........")]) == "#"
"""(rows, columns): no mirror image and no quarter turn of it is the same."""


def stored_bits(content: bytes, form: str) -> np.ndarray:
    """(rows, columns) of the bits as stored, the row first that is shown on top."""
    return {"tiff": tiff_bits, "png": png_bits, "bmp": bmp_bits}[form](content)


def tiff_bits(content: bytes) -> np.ndarray:
    with tifffile.TiffFile(io.BytesIO(content)) as file:
        page = file.pages.first
        assert (page.compression, page.photometric) == (tifffile.COMPRESSION.CCITT_T6, tifffile.PHOTOMETRIC.MINISWHITE)
        assert (page.tags["Orientation"].value, page.tags["RowsPerStrip"].value) == (1, page.shape[0])
        return np.asarray(page.asarray())


def png_chunks(content: bytes) -> dict[bytes, bytes]:
    assert content.startswith(b"\x89PNG\r\n\x1a\n")
    chunks, place = dict[bytes, bytes](), 8
    while place < len(content):
        size, kind = struct.unpack_from(">I4s", content, place)
        data = content[place + 8 : place + 8 + size]
        assert struct.unpack_from(">I", content, place + 8 + size)[0] == zlib.crc32(kind + data)
        chunks[kind] = chunks.get(kind, b"") + data
        place += 12 + size
    return chunks


def png_bits(content: bytes) -> np.ndarray:
    """Colour type 3 of one bit; filtered rows as the PNG specification (section 9) has them."""
    chunks = png_chunks(content)
    width, height, depth, colour, *_ = struct.unpack(">IIBBBBB", chunks[b"IHDR"])
    assert (depth, colour, chunks[b"PLTE"][:6]) == (1, 3, b"\xff\xff\xff\0\0\0")
    filtered = np.frombuffer(zlib.decompress(chunks[b"IDAT"]), np.uint8).reshape(height, -1).astype(int)
    rows = np.zeros((height + 1, filtered.shape[1]), int)  # a row above and a byte to the left, both 0
    for row, (kind, *values) in enumerate(filtered.tolist(), start=1):
        for place, value in enumerate(values, start=1):
            left, up, corner = rows[row, place - 1], rows[row - 1, place], rows[row - 1, place - 1]
            nearest = min((left, up, corner), key=lambda one: abs(left + up - corner - one))  # first one wins
            rows[row, place] = (value + (0, left, up, (left + up) // 2, nearest)[kind]) % 256
    return np.unpackbits(rows[1:, 1:].astype(np.uint8), axis=1)[:, :width].astype(bool)


def bmp_bits(content: bytes) -> np.ndarray:
    kind, size, _, _, begin, _, width, height, planes, depth, packing = struct.unpack_from("<2sIHHIIiiHHI", content)
    assert (kind, size, planes, depth, packing) == (b"BM", len(content), 1, 1, 0)
    assert content[54:62] == b"\xff\xff\xff\0\0\0\0\0"
    rows = np.frombuffer(content[begin:], np.uint8).reshape(height, -1)
    assert rows.shape[1] % 4 == 0
    return np.unpackbits(rows[::-1], axis=1)[:, :width].astype(bool)


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
