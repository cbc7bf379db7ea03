"""How long frames take on a real CAN bus: classic ones with 11-bit ids, stuff bits counted from their content."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

CRC_POLYNOMIAL = 0x4599  # ISO 11898-1, CRC of 15 bits
UNSTUFFED_BITS = 1 + 2 + 7 + 3  # CRC delimiter, acknowledge slot and delimiter, end of frame, intermission
HEAD_BITS = 1 + 11 + 3 + 4  # start, id, RTR IDE r0, length
SAMPLE = 4000  # frames of which the stuff bits are counted; a map's frames are alike


@dataclass(frozen=True)
class BusTime:
    """Frames, and their bits with the stuff bits that they have and with the most that they could have."""

    frames: int
    bits: float
    bits_worst: float

    def seconds(self, bitrate: float) -> tuple[float, float]:
        """Time of the bits on a bus that does nothing else [s]: as they are, and at worst."""
        return self.bits / bitrate, self.bits_worst / bitrate


def bus_time(frames: Sequence[tuple[int, bytes]]) -> BusTime:
    """Of frames (id, data); of many, the stuff bits are counted in an even sample."""
    worst = sum(worst_bits(len(data)) for _, data in frames)
    plain = sum(HEAD_BITS + 8 * len(data) + 15 + UNSTUFFED_BITS for _, data in frames)
    sample = frames[:: max(1, len(frames) // SAMPLE)]
    stuffed = sum(stuff_bits(identifier, data) for identifier, data in sample)
    return BusTime(len(frames), plain + stuffed * len(frames) / max(1, len(sample)), worst)


def worst_bits(length: int) -> int:
    """Bits of a frame of so many bytes at worst: a stuff bit after the first five, then after every four."""
    stuffable = HEAD_BITS + 8 * length + 15
    return stuffable + (stuffable - 1) // 4 + UNSTUFFED_BITS


def stuff_bits(identifier: int, data: bytes) -> int:
    """Stuff bits of a frame: one of the other value after every five of one value, counting stuff bits too."""
    head = f"0{identifier:011b}000{len(data):04b}"
    bits = head + "".join(f"{byte:08b}" for byte in data)
    bits += f"{_crc(bits):015b}"
    stuffed, run, last = 0, 0, ""
    for bit in bits:
        run = run + 1 if bit == last else 1
        last = bit
        if run == 5:
            stuffed += 1
            last, run = "1" if bit == "0" else "0", 1
    return stuffed


def _crc(bits: str) -> int:
    crc = 0
    for bit in bits:
        is_odd = (crc >> 14 & 1) != int(bit)
        crc = crc << 1 & 0x7FFF
        if is_odd:
            crc ^= CRC_POLYNOMIAL
    return crc
