"""Bitmaps of one bit a pixel, in TIFF, PNG and BMP.

In all of them the first row is y = 0, the first column x = 0, and a set bit is a droplet, shown black on white.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from inkloop.component import BoolMap
from inkloop.units import M_PER_CM, M_PER_INCH, UM_PER_M

_WHITE_AND_BLACK = (255, 255, 255, 0, 0, 0)
_CENTIMETRE, _TOP_LEFT, _MIN_IS_WHITE = 3, 1, 0  # TIFF 6.0, tags 296, 274 and 262
_PHOTOMETRIC, _ORIENTATION, _ROWS_PER_STRIP = 262, 274, 278
_ENTRY = struct.Struct("<HHIHH")  # TIFF 6.0, section 2: tag, type, count, and a value of 16 bits
_BMP_PER_METRE = struct.Struct("<ii")


def encode(droplets: BoolMap, pitch: float, form: str, title: str) -> bytes:
    """The file of a bitmap (nx, ny) with its resolution; form: one of BITMAP_FORMATS; pitch: of the pixels [m].

    PNG and BMP hold whole pixels per metre, PNG also the pitch as text; TIFF holds the pitch to 1e-7.
    """
    return _ENCODERS[form](np.ascontiguousarray(droplets.T), pitch, title)


def stored_pitch(pitch: float, form: str) -> float:
    """The pitch that a format can store [m]."""
    return pitch if form == "tiff" else 1.0 / round(1.0 / pitch)


def pitch_text(pitch: float) -> str:
    """A pitch in um, to twelve digits."""
    return f"{pitch * UM_PER_M:.12g}"


def _tiff(rows: NDArray[np.bool_], pitch: float, title: str) -> bytes:
    """TIFF 6.0, one strip, compressed as Group 4 fax (ITU-T T.6)."""
    image = Image.frombytes("1", rows.shape[::-1], np.packbits(rows, axis=1).tobytes())
    file = io.BytesIO()
    per_cm = M_PER_CM / pitch
    image.save(
        file,
        "TIFF",
        compression="group4",
        resolution_unit=_CENTIMETRE,
        x_resolution=per_cm,
        y_resolution=per_cm,
        description=f"{title}; pitch_um = {pitch_text(pitch)}",
        software="inkloop",
        tiffinfo={_ROWS_PER_STRIP: len(rows), _ORIENTATION: _TOP_LEFT},
    )
    return _min_is_white(file.getvalue())


def _min_is_white(tiff: bytes) -> bytes:
    """The same bits with the meaning that a set one is black; Pillow would invert every pixel for that."""
    content = bytearray(tiff)
    directory = struct.unpack_from("<I", content, 4)[0]
    for number in range(struct.unpack_from("<H", content, directory)[0]):
        place = directory + 2 + number * _ENTRY.size
        tag, kind, count, _, rest = _ENTRY.unpack_from(content, place)
        if tag == _PHOTOMETRIC:
            _ENTRY.pack_into(content, place, tag, kind, count, _MIN_IS_WHITE, rest)
    return bytes(content)


def _png(rows: NDArray[np.bool_], pitch: float, title: str) -> bytes:
    image = Image.fromarray(rows.astype(np.uint8)).convert("L")
    image.putpalette(_WHITE_AND_BLACK)
    text = PngInfo()
    for key, value in (("Title", title), ("Software", "inkloop"), ("pitch_um", pitch_text(pitch))):
        text.add_text(key, value)
    file = io.BytesIO()
    per_inch = round(1.0 / pitch) * M_PER_INCH
    image.save(file, "PNG", bits=1, dpi=(per_inch, per_inch), pnginfo=text)
    return file.getvalue()


def _bmp(rows: NDArray[np.bool_], pitch: float, title: str) -> bytes:
    """Windows bitmap of two colours; it stores the last row first, and has no room for text."""
    file = io.BytesIO()
    Image.fromarray(rows).save(file, "BMP")
    content = bytearray(file.getvalue())
    _BMP_PER_METRE.pack_into(content, 38, *[round(1.0 / pitch)] * 2)  # Pillow converts to inches, and not exactly
    content[54:62] = 255, 255, 255, 0, 0, 0, 0, 0  # colours: in Pillow's files a set bit is white
    return bytes(content)


_ENCODERS: Mapping[str, Callable[[NDArray[np.bool_], float, str], bytes]] = {"tiff": _tiff, "png": _png, "bmp": _bmp}
