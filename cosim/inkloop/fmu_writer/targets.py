"""The platforms of FMUs and wheels: names, folders in an FMU, compiler targets."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from inkloop.errors import FmuError, near


@dataclass(frozen=True)
class Target:
    """A platform.

    name: of FMI 3, also of its folder in binaries/; fmi2_folder: None where FMI 2 has no name for it; triple: for
    `zig cc`, with the oldest C library or system; system: as CMake calls it; wheel: tag of a Python package.
    """

    name: str
    fmi2_folder: str | None
    triple: str
    system: str
    suffix: str
    wheel: str

    def folder(self, fmi: str) -> str | None:
        """Its folder below binaries/ in an FMU of FMI "2" or "3"."""
        return self.name if fmi == "3" else self.fmi2_folder


TARGETS = {
    target.name: target
    for target in (
        Target("x86_64-linux", "linux64", "x86_64-linux-gnu.2.17", "Linux", ".so", "manylinux_2_17_x86_64"),
        Target("aarch64-linux", None, "aarch64-linux-gnu.2.17", "Linux", ".so", "manylinux_2_17_aarch64"),
        Target("x86_64-windows", "win64", "x86_64-windows-gnu", "Windows", ".dll", "win_amd64"),
        Target("aarch64-windows", None, "aarch64-windows-gnu", "Windows", ".dll", "win_arm64"),
        Target("x86_64-darwin", "darwin64", "x86_64-macos.11.0", "Darwin", ".dylib", "macosx_11_0_x86_64"),
        Target("aarch64-darwin", "darwin64", "aarch64-macos.11.0", "Darwin", ".dylib", "macosx_11_0_arm64"),
    )
}
"""Name -> target. In FMI 2 linux64 and win64 mean x86_64, and darwin64 holds one binary for both processors."""

ALL = "all"


def targets_of(names: Iterable[str], fmi: str) -> dict[str, list[Target]]:
    """Folder below binaries/ -> its targets, for the named platforms or "all".

    Raises FmuError for unknown names, and for platforms without a folder in FMI 2.
    """
    asked = list(names)
    errors = [
        f"there is no platform {name!r}{_meant(name)}; known are {', '.join(TARGETS)} and {ALL}"
        for name in asked
        if name != ALL and name not in TARGETS
    ]
    errors += [
        f"FMI 2 has no folder for {name}; use FMI 3"
        for name in asked
        if name in TARGETS and TARGETS[name].folder(fmi) is None
    ]
    if errors or not asked:
        raise FmuError("; ".join(errors or ["no platform is named"]))
    wanted = {target.folder(fmi) for target in TARGETS.values() if ALL in asked or target.name in asked}
    return {
        folder: [target for target in TARGETS.values() if target.folder(fmi) == folder]
        for folder in sorted(folder for folder in wanted if folder is not None)
    }


def universal(binaries: Sequence[bytes]) -> bytes:
    """One Mach-O file of several for one processor each (the fat format of macOS); a single one stays as it is."""
    if len(binaries) == 1:
        return binaries[0]
    alignment = 14  # as a power of two: pages of 16 KiB
    page = 1 << alignment
    header = struct.pack(">II", 0xCAFEBABE, len(binaries))
    offset, body = page, bytearray(page)
    for binary in binaries:
        magic, processor, kind = struct.unpack_from("<Iii", binary)
        if magic != 0xFEEDFACF:
            raise FmuError(f"a binary for macOS begins with {magic:#x}; expected a 64-bit Mach-O file")
        header += struct.pack(">iiIII", processor, kind, offset, len(binary), alignment)
        body += binary + bytes(-len(binary) % page)
        offset = len(body)
    body[: len(header)] = header
    return bytes(body)


MAGIC: Mapping[bytes, tuple[str, Mapping[int, str]]] = {
    b"\x7fELF": ("linux", {62: "x86_64", 183: "aarch64"}),
    b"MZ": ("windows", {0x8664: "x86_64", 0xAA64: "aarch64"}),
    b"\xcf\xfa\xed\xfe": ("darwin", {0x01000007: "x86_64", 0x0100000C: "aarch64"}),
}
"""First bytes of a binary -> system, and number of the processor -> its name (ELF, PE, Mach-O)."""


def platforms_in(binary: bytes) -> list[str]:
    """Names of the platforms of a binary, by its header; none for any other file."""
    if binary.startswith(b"\xca\xfe\xba\xbe"):
        (count,) = struct.unpack_from(">I", binary, 4)
        parts = [struct.unpack_from(">iiIII", binary, 8 + 20 * k) for k in range(count)]
        return [name for part in parts for name in platforms_in(binary[part[2] : part[2] + part[3]])]
    for magic, (system, processors) in MAGIC.items():
        if not binary.startswith(magic):
            continue
        match system:
            case "linux":
                (number,) = struct.unpack_from("<H", binary, 18)
            case "windows":
                (header,) = struct.unpack_from("<I", binary, 0x3C)
                (number,) = struct.unpack_from("<H", binary, header + 4)
            case _:
                (number,) = struct.unpack_from("<I", binary, 4)
        return [f"{processors[number]}-{system}"] if number in processors else []
    return []


def _meant(name: str) -> str:
    close = near(name, TARGETS)
    return f", did you mean {' or '.join(close)}" if close else ""
