"""Grey values of pictures: PNG, BMP and TIFF with bits, grey values or a palette, one page after the other."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageSequence, UnidentifiedImageError

from inkloop.errors import HeightMapError
from inkloop.files import regular
from inkloop.limits import memory_error
from inkloop.metrology.map_readers import FileContents

FORMATS = ("PNG", "TIFF", "BMP")
"""Formats that keep every value; JPEG and others change them."""
_COLOURS = 3  # channels before the one of opacity
_BITS_PER_SAMPLE = 258  # a tag of TIFF 6.0
_PHOTOMETRIC, _MIN_IS_WHITE = 262, 0  # another, and one of its values
_PACKED_MODES = ("LA", "RGB", "RGBA")
"""Modes for which Pillow keeps 8 bits per channel, even if the file has 16."""
_BYTES_OF_A_PIXEL = 8  # the picture, its array, and a copy; of colours 4 bytes twice
_DAMAGED = (OSError, SyntaxError, TypeError, ValueError, EOFError, KeyError)
"""Errors of Pillow on truncated or altered bytes."""


def read_picture(path: Path) -> FileContents:
    """The first page as whole-number counts; row 0 is the first row along y. Raises HeightMapError, OSError."""
    return FileContents(next(grey_pages(path, indexed=False)))


def grey_pages(path: Path, *, indexed: bool = True) -> Iterator[NDArray[Any]]:
    """The grey values of each page as stored, (rows, columns): 0 and 1 of bits.

    Of a palette the index counts, or the grey value that it stands for, if not `indexed`. Colours are read where all of
    them are grey and opaque. Raises HeightMapError, OSError.
    """
    try:
        with _quietly():
            picture = Image.open(regular(path), formats=FORMATS)
        with picture:
            if picture.format == "BMP" and (reason := _bmp_error(path)):
                raise HeightMapError(f"{path}: {reason}")
            for number in count(1):
                with _quietly():  # not while the caller has the page
                    page = _page(picture, number)
                    if page is None:
                        return
                    values = _values(f"{path}, page {number}" if number > 1 else str(path), page, indexed)
                yield values
    except Image.DecompressionBombError as error:
        raise HeightMapError(f"{path}: {error}; save it in parts, or with fewer pixels") from error
    except UnidentifiedImageError as error:
        raise HeightMapError(
            f"{path}: is no picture that can be read; expected PNG, BMP, or TIFF of 32 bits for a pixel at most"
        ) from error
    except _DAMAGED as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise
        raise HeightMapError(f"{path}: is damaged ({error}); save it again") from error


def _bmp_error(path: Path) -> str | None:
    """The reason why rows may be shifted: a BMP has no checksum, but the size of the file in its bytes 2 to 5."""
    stated, size = int.from_bytes(path.read_bytes()[2:6], "little"), path.stat().st_size
    return None if stated == size else f"is damaged (it has {size} bytes and states {stated}); save it again"


@contextmanager
def _quietly() -> Iterator[None]:
    """Without Pillow's warnings: memory is checked here, page by page, and what it cannot read is an error."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def _page(picture: Image.Image, number: int) -> Image.Image | None:
    """Page `number` from 1 on, None behind the last."""
    try:
        return ImageSequence.Iterator(picture)[number - 1]
    except IndexError:
        return None


def _values(place: str, page: Image.Image, indexed: bool) -> NDArray[Any]:
    pixels, held = page.width * page.height, _held_pixels(page)
    if held < pixels:  # Pillow would leave the others 0, and take memory for them
        raise HeightMapError(f"{place}: is damaged (it holds {held:,} of its {pixels:,} pixels); save it again")
    if reason := memory_error(pixels * _BYTES_OF_A_PIXEL):
        raise HeightMapError(f"{place}: {page.width} x {page.height} pixels: {reason}")
    if page.mode in _PACKED_MODES and _has_16_bits(page):
        raise HeightMapError(f"{place}: has colours of 16 bits; expected grey values: save it as greyscale")
    return _grey(place, page if indexed or page.mode != "P" else page.convert("RGBA"))


def _held_pixels(page: Image.Image) -> int:
    """Number of pixels with data in the strips or tiles of a page."""
    whole = (0, 0, page.width, page.height)
    extents = (tile[1] or whole for tile in getattr(page, "tile", [(None, whole)]))
    return sum((right - left) * (lower - upper) for left, upper, right, lower in extents)


def _grey(place: str, page: Image.Image) -> NDArray[Any]:
    values = np.asarray(page)
    if values.dtype == np.bool_:
        values = values.astype(np.uint8)
        return 1 - values if _is_inverted(page) else values
    if values.ndim == 2:
        return np.iinfo(np.uint8).max - values if page.mode == "L" and _is_inverted(page) else values
    channels = len(page.getbands())
    has_opacity = page.mode.endswith(("A", "a"))
    is_grey = channels <= 2 or (values[..., 1:_COLOURS] == values[..., :1]).all()
    is_opaque = not has_opacity or (values[..., -1] == np.iinfo(values.dtype).max).all()
    if page.mode not in _PACKED_MODES or not (is_grey and is_opaque):
        found = "is partly transparent" if is_grey and not is_opaque else f"has colours ({page.mode})"
        raise HeightMapError(f"{place}: {found}; expected grey values: save it as greyscale")
    return np.ascontiguousarray(values[..., 0])


def _has_16_bits(page: Image.Image) -> bool:
    """Whether a channel has 16 bits: by a tag of TIFF, in PNG by the mode that the decoder is given."""
    arguments = [tile[3] for tile in getattr(page, "tile", ())]
    raw_modes = [each[0] if isinstance(each, tuple) and each else each for each in arguments]
    bits = getattr(page, "tag_v2", {}).get(_BITS_PER_SAMPLE, ())
    return max(bits, default=0) > 8 or any(";16" in str(mode) for mode in raw_modes)


def _is_inverted(page: Image.Image) -> bool:
    """Whether Pillow inverts the stored values: TIFF whose 0 is white."""
    return getattr(page, "tag_v2", {}).get(_PHOTOMETRIC) == _MIN_IS_WHITE
