"""Readers of bitmaps of one bit that share no code with the writers.

TIFF is read by tifffile with the decoder of imagecodecs, PNG and BMP byte by byte as their specifications have them.
"""

from __future__ import annotations

import io
import struct
import zlib

import numpy as np
import tifffile


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
