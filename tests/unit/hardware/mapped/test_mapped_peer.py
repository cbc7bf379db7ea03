"""Services of a peer: blocks in both directions, repeats, and matching of messages to requests."""

from __future__ import annotations

import zlib
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock, call

import pytest
from udsoncan import MemoryLocation
from udsoncan.exceptions import InvalidResponseException, NegativeResponseException, TimeoutException
from udsoncan.Response import Response

from inkloop_hardware.errors import LinkTimeout, NodeRefused, TransferError
from inkloop_hardware.mapped.mapped_peer import TRIES, Peer, is_answer

PLACE = MemoryLocation(3, 300, 32, 16)


def peer(block: int = 24) -> Any:
    """A peer whose client and connection are doubles."""
    made: Any = object.__new__(Peer)
    made.name = "head (0x7A0, 0x7A8)"
    made._wire, made._client, made._connection = MagicMock(), MagicMock(), SimpleNamespace(deadline=None)
    made._wire.now.return_value = 50.0
    made._client.request_download.return_value.service_data.max_length = block
    return made


def pieces(made: Any, *data: bytes, end: bytes = b"") -> None:
    """Blocks of an upload, and the record of its end."""
    made._client.transfer_data.side_effect = [
        SimpleNamespace(service_data=SimpleNamespace(parameter_records=piece)) for piece in data
    ]
    made._client.request_transfer_exit.return_value.service_data.parameter_records = end


@pytest.mark.parametrize("crc", [False, True])
def test_blocks_of_a_download_leave_room_for_their_head_and_count_from_one_to_255_to_zero(crc: bool) -> None:
    made, blob = peer(24), bytes(range(256)) * 23
    made.download(PLACE, blob, crc)
    made._client.request_download.assert_called_once_with(PLACE)
    sent = [one.args for one in made._client.transfer_data.mock_calls]
    assert [number for number, _ in sent] == [number % 256 for number in range(1, len(sent) + 1)]
    assert {len(data) for _, data in sent[:-1]} == {22}
    assert b"".join(data for _, data in sent) == blob
    assert len(sent) > 256
    record = zlib.crc32(blob).to_bytes(4, "big") if crc else None
    made._client.request_transfer_exit.assert_called_once_with(record)


def test_block_is_no_longer_than_a_message_of_iso_tp() -> None:
    made = peer(0xFFFF)
    made.download(PLACE, bytes(5000), False)
    assert [len(one.args[1]) for one in made._client.transfer_data.mock_calls] == [4093, 907]


def test_blocks_without_room_are_refused() -> None:
    with pytest.raises(TransferError, match=r"^head .* takes blocks of 2 bytes; needs 3 at least, two are their head"):
        peer(2).download(PLACE, b"a", False)


def test_upload_ends_with_its_size_and_its_checksum() -> None:
    made, data = peer(), b"abcdefgh"
    pieces(made, b"abc", b"defgh", b"too much", end=zlib.crc32(data).to_bytes(4, "big"))
    assert made.upload(PLACE, 8, True) == data
    assert made._client.transfer_data.mock_calls == [call(1), call(2)]
    long = peer()
    pieces(long, *[b"a"] * 300)
    assert long.upload(PLACE, 300, False) == b"a" * 300
    assert long._client.transfer_data.mock_calls == [call(number % 256) for number in range(1, 301)]
    short = peer()
    pieces(short, b"abc", b"", b"never")
    assert short.upload(PLACE, 8, False) == b"abc"
    altered = peer()
    pieces(altered, *[b"abcdefgX"] * 3, end=zlib.crc32(data).to_bytes(4, "big"))
    with pytest.raises(TransferError, match="the checksum of the upload differs"):
        altered.upload(PLACE, 8, True)
    assert altered._client.request_upload.call_count == TRIES
    pieces(altered, b"abcdefgX", end=b"any")
    assert altered.upload(PLACE, 8, False) == b"abcdefgX"


def test_request_without_an_answer_is_repeated_twice_and_a_routine_never() -> None:
    silent = peer()
    silent._client.read_data_by_identifier.side_effect = TimeoutException
    with pytest.raises(LinkTimeout, match=r"^no answer of head \(0x7A0, 0x7A8\): identifier 0x0107 \(0x22\); is it"):
        silent.read(0x107)
    assert silent._client.read_data_by_identifier.call_count == 3
    assert silent._wire.check.call_count == 2
    deadlines: list[float] = []

    def never(*_: object) -> None:
        deadlines.append(silent._connection.deadline)
        raise TimeoutException

    silent._client.start_routine.side_effect = never
    with pytest.raises(LinkTimeout, match="Whether it was done is unknown: check the rig before you continue"):
        silent.routine(0x310, b"\1", 5.0)
    assert silent._client.start_routine.mock_calls == [call(0x310, b"\1")]
    assert (deadlines, silent._connection.deadline) == ([55.0], None)
    silent._wire.now.side_effect = [50.0, 55.1]
    with pytest.raises(
        LinkTimeout, match=r"was still busy with routine 0x0310 \(0x31\) after 5 s, .*\. Whether it was"
    ):
        silent.routine(0x310, b"\1", 5.0)


def test_value_of_the_second_try_counts_and_a_refusal_is_not_tried_again() -> None:
    made = peer()
    found = SimpleNamespace(service_data=SimpleNamespace(values={0x107: b"\5", 0x108: b"\6"}))
    made._client.read_data_by_identifier.side_effect = [InvalidResponseException(Response()), found]
    assert made.read(0x107) == b"\5"
    refusal = Response.from_payload(b"\x7f\x22\x31")
    made._client.read_data_by_identifier.side_effect = NegativeResponseException(refusal)
    with pytest.raises(
        NodeRefused, match=r"refuses: identifier 0x0107 \(0x22\): RequestOutOfRange \(0x31\)"
    ) as refused:
        made.read(0x107)
    assert refused.value.code == 0x31
    assert made._client.read_data_by_identifier.call_count == 3


@pytest.mark.parametrize(
    ("request_", "message", "expected"),
    [
        ("22 01 07", "62 01 07 05", True),
        ("22 01 07", "62 01 08 05", False),
        ("22 01 07", "71 01 07", False),
        ("22 01 07", "7f 22 31", True),
        ("22 01 07", "7f 31 31", False),
        ("22 01 07", "", False),
        ("31 01 03 10 00", "71 01 03 10 01", True),
        ("31 01 03 10 00", "71 01 03 11 01", False),
        ("31 01 03 10 00", "71 03 03 10 01", False),
        ("36 05 aa", "76 05", True),
        ("36 05 aa", "76 04", False),
        ("37", "77 01 02", True),
        ("34 00 44", "74 20 00", True),
        ("34 00 44", "75 20 00", False),
    ],
)
def test_answer_repeats_what_it_answers(request_: str, message: str, expected: bool) -> None:
    assert is_answer(bytes.fromhex(request_), bytes.fromhex(message)) is expected
