from __future__ import annotations

import pytest

from inkloop.units import QUANTITIES, SUFFIXES, missing_suffix, parse_key, spellings


@pytest.mark.parametrize(
    ("key", "expected"),
    [
        ("pitch_um", ("pitch", "m", 1e-6)),
        ("noise_std_nm", ("noise_std", "m", 1e-9)),
        ("layer_duration_s", ("layer_duration", "s", 1.0)),
        ("layer_duration_ms", ("layer_duration", "s", 1e-3)),
        ("droplet_volume_pl", ("droplet_volume", "m3", 1e-15)),
        ("speed_mm_per_s", ("speed", "m/s", 1e-3)),
        ("variation", ("variation", "1", 1.0)),
        ("h1_a", ("h1_a", "1", 1.0)),
    ],
)
def test_key_carries_its_unit(key: str, expected: tuple[str, str, float]) -> None:
    assert parse_key(key) == expected


def test_every_spelling_is_read_back() -> None:
    for unit in SUFFIXES:
        for key, factor in spellings("quantity", unit).items():
            assert parse_key(key) == ("quantity", unit, factor)


def test_length_without_a_unit_is_a_fault() -> None:
    assert missing_suffix("pitch", "m") == "pitch is a length; write pitch_um, pitch_mm, pitch_nm or pitch_m"
    assert missing_suffix("variation", "1") is None
    assert spellings("variation", "1") == {"variation": 1.0}
    assert set(QUANTITIES) == set(SUFFIXES)
