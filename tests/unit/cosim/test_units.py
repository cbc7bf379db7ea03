from __future__ import annotations

from inkloop.units import QUANTITIES, SUFFIXES, missing_suffix, spellings, unit_of


def test_key_carries_its_unit() -> None:
    assert spellings("pitch", "m") == {"pitch_um": 1e-6, "pitch_mm": 1e-3, "pitch_nm": 1e-9, "pitch_m": 1.0}
    assert spellings("duration", "s")["duration_ms"] == 1e-3
    assert spellings("droplet_volume", "m3")["droplet_volume_pl"] == 1e-15
    assert spellings("speed", "m/s")["speed_mm_per_s"] == 1e-3
    assert spellings("gain", "1/m") == {"gain_per_um": 1e6, "gain_per_mm": 1e3, "gain_per_m": 1.0}


def test_length_without_a_unit_is_a_fault() -> None:
    assert missing_suffix("pitch", "m") == "pitch is a length; write pitch_um, pitch_mm, pitch_nm or pitch_m"
    assert missing_suffix("variation", "1") is None
    assert spellings("variation", "1") == {"variation": 1.0}
    assert set(QUANTITIES) == set(SUFFIXES)


def test_key_says_in_which_unit_its_number_is() -> None:
    assert unit_of("pitch_um", "pitch", "m") == ("um", 1e-6)
    assert unit_of("speed_mm_per_s", "speed", "m/s") == ("mm/s", 1e-3)
    assert unit_of("gain_per_um", "gain", "1/m") == ("1/um", 1e6)
    assert unit_of("variation", "variation", "1") == ("1", 1.0)
