"""Limits on what input may ask of this machine: memory, disk, cores, archives, filled-in templates, XML entities."""

from __future__ import annotations

import io
import os
import re
import shutil
import string
import zipfile
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, TYPE_CHECKING
from xml.parsers import expat

if TYPE_CHECKING:
    from xml.etree import ElementTree

KIB, MIB, GIB = 1 << 10, 1 << 20, 1 << 30
UNPACKED_MAX = 4 * GIB
"""Bytes that an archive may unpack to (assumed: FMUs with the binaries and tables of large tools hold less)."""
MEMBERS_MAX = 65_535
"""Members of an archive: those that plain ZIP can count."""
PLAIN_SIZE = 256 * MIB
PACKED_AT_MOST = 200
"""Bytes from one byte of an archive that unpacks to more than PLAIN_SIZE; descriptions of FMUs reach 30, noisy maps 2,
and archives made to fill a disk 1000 (deflate)."""
ROUNDED_CELLS = 1 << 18
"""Maps with more cells are rounded in result.nc: otherwise digits of noise would be most of the file."""
_FILLED_MAX = 64
_FORMAT = re.compile(r"0?(\d{0,2})[bdoxX]?")
_PROC = Path("/proc")
_CGROUP = Path("/sys/fs/cgroup")


def available_memory() -> int | None:
    """Bytes that this process may allocate without swapping, by the system and its limits; None where unknown."""
    found = [limit for limit in (_of_system(), _of_address_space(), *_of_control_groups()) if limit is not None]
    return max(0, min(found)) if found else None


def free_disk(folder: Path) -> int | None:
    """Free bytes on the disk that `folder` is on, or will be when it is made; None where unknown."""
    place = next((path for path in (folder.absolute(), *folder.absolute().parents) if path.exists()), None)
    try:
        return None if place is None else shutil.disk_usage(place).free
    except OSError:
        return None


def usable_cores() -> int:
    """Cores that this process may use; at most OMP_NUM_THREADS, where that is set to a number."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    limit = os.environ.get("OMP_NUM_THREADS", "")
    return max(1, min(cores, int(limit))) if limit.isdecimal() else cores


def size_text(count: float) -> str:
    """A number of bytes for a person, "1.4 GiB"."""
    unit, size = next(
        ((unit, size) for unit, size in (("TiB", GIB * KIB), ("GiB", GIB), ("MiB", MIB)) if count >= size), ("KiB", KIB)
    )
    return f"{plain_text(count / size)} {unit}"


def duration_text(seconds: float) -> str:
    """A time for a person, "3.5 min"."""
    if seconds < 120.0:
        return f"{seconds:.3g} s"
    return f"{seconds / 60.0:.3g} min" if seconds < 7200.0 else f"{plain_text(seconds / 3600.0)} h"


def plain_text(number: float, digits: int = 3) -> str:
    """At least so many digits, and no exponent of ten for a large number."""
    return f"{number:.{digits}g}" if number < 10.0 ** (digits - 1) else f"{number:,.0f}"


def rounded_text(number: float, digits: int) -> str:
    """So many digits, and no exponent of ten for a large number."""
    return plain_text(float(f"{number:.{digits}g}"), digits)


def memory_error(needed: float) -> str | None:
    """The reason why `needed` more bytes cannot be allocated: "needs ... of memory, ... are available"."""
    available = available_memory()
    if available is None or needed <= available:
        return None
    return f"needs about {size_text(needed)} of memory, {size_text(available)} are available"


def unpacked_error(archive: zipfile.ZipFile) -> str | None:
    """The reason why an archive is not unpacked: its directory, whose sizes unpacking does not exceed."""
    members = archive.infolist()
    if len(members) > MEMBERS_MAX:
        return f"holds {len(members):,} members; at most {MEMBERS_MAX:,} are taken"
    names = Counter(name for name, *_ in {(member.filename, member.CRC, member.file_size) for member in members})
    if twice := next((name for name, count in names.items() if count > 1), None):
        return f"holds {twice!r} twice, with other contents, of which every reader takes another one; pack it again"
    unpacked, packed = sum(member.file_size for member in members), sum(member.compress_size for member in members)
    found = f"unpacks to {size_text(unpacked)}"
    if unpacked > UNPACKED_MAX:
        return f"{found}; at most {size_text(UNPACKED_MAX)} are taken"
    if unpacked > max(PLAIN_SIZE, PACKED_AT_MOST * packed):
        return (
            f"{found}, {unpacked / max(1, packed):.0f} times its size; beyond {size_text(PLAIN_SIZE)} at most "
            f"{PACKED_AT_MOST} times are taken: pack it without compression if it is right"
        )
    return None


def filled(template: str, fields: Mapping[str, int]) -> str:
    """`str.format` for whole numbers in decimal, hexadecimal, octal or binary, at most 64 characters wide.

    Raises ValueError for any other field or format.
    """
    for _, name, form, conversion in string.Formatter().parse(template):
        if name is None:
            continue
        if name not in fields:
            raise ValueError(f"{{{name}}} is none of {', '.join(f'{{{known}}}' for known in fields)}")
        match = _FORMAT.fullmatch(form or "")
        if match is None or conversion is not None or int(match[1] or 0) > _FILLED_MAX:
            found = f"{{{name}:{(form or '')[:20]}}}"
            raise ValueError(f"{found} has a format other than d, x, X, o or b, or more than {_FILLED_MAX} digits")
    return template.format(**fields)


class XmlError(ValueError):
    """XML is damaged, or declares a document type (DTD), and so entities, which expand and may name other files."""


class _Begins(Exception):
    """The first element, which no document type follows."""


def check_xml(file: IO[bytes], encoding: str | None = None) -> None:
    """Raises XmlError for a document type; reads up to the first element, before another parser reads it all.

    encoding: None is that which the file declares.
    """

    def refuse(*_: object) -> None:
        raise XmlError("declares a document type (DOCTYPE), which is not read; save it without one")

    def begin(*_: object) -> None:
        raise _Begins

    try:
        parser = expat.ParserCreate(encoding)
        parser.StartDoctypeDeclHandler, parser.StartElementHandler = refuse, begin
        parser.ParseFile(file)
    except _Begins:
        return
    except XmlError:
        raise
    except (expat.ExpatError, LookupError, ValueError) as error:  # the last two: encodings that expat does not take
        raise XmlError(f"is no XML: {error}") from error


def parsed_xml(content: bytes | str) -> ElementTree.Element:
    """The root element; a text has lost the encoding that it declares. Raises XmlError."""
    from xml.etree import ElementTree

    if isinstance(content, str):
        check_xml(io.BytesIO(content.encode()), "utf-8")
    else:
        check_xml(io.BytesIO(content))
    try:
        return ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError) as error:
        raise XmlError(f"is no XML: {error}") from error


def _of_system() -> int | None:
    """MemAvailable of Linux; elsewhere all memory there is."""
    for line in _lines(_PROC / "meminfo"):
        if line.startswith("MemAvailable:"):
            return int(line.split()[1]) * KIB
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):  # Windows has no sysconf
        return None


def _of_address_space() -> int | None:
    """Address space left under `ulimit -v`."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit == resource.RLIM_INFINITY:
        return None
    pages = next((int(line.split()[0]) for line in _lines(_PROC / "self" / "statm")), 0)
    return limit - pages * resource.getpagesize()


def _of_control_groups() -> Iterator[int]:
    """Memory left under the container's limits (cgroup v2); file cache can be given back and does not count."""
    for line in _lines(_PROC / "self" / "cgroup"):
        if not line.startswith("0::"):
            continue
        own = _CGROUP / line.partition("::")[2].strip("/")
        for group in (own, *own.parents):
            limit = next(iter(_lines(group / "memory.max")), "max")
            used = next(iter(_lines(group / "memory.current")), "")
            if limit != "max" and used:
                cache = dict(line.split() for line in _lines(group / "memory.stat")).get("inactive_file", "0")
                yield int(limit) - int(used) + int(cache)
            if group == _CGROUP:
                break


def _lines(path: Path) -> list[str]:
    """The lines of a file of the system, none where it does not exist."""
    try:
        return path.read_text(encoding="ascii").splitlines()
    except (OSError, UnicodeDecodeError):
        return []
