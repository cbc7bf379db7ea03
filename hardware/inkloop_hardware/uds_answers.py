"""What comes back from a UDS request: whether it is the answer, and identifiers as their bytes."""

from __future__ import annotations

import udsoncan
from udsoncan.exceptions import InvalidResponseException, UnexpectedResponseException

UNREADABLE = (InvalidResponseException, UnexpectedResponseException, NotImplementedError)
"""What udsoncan raises for an answer that is none; the last one for numbers of more than 64 bits."""
NEGATIVE, POSITIVE = 0x7F, 0x40
ECHOED = {0x22: slice(1, 3), 0x36: slice(1, 2)}
"""Bytes of a request that its positive answer begins with again."""
ROUTINE_CONTROL, KEY_AT, KEY_ECHO = 0x31, slice(4, 12), slice(5, 13)


class Bytes(udsoncan.DidCodec):
    """An identifier as its bytes."""

    def encode(self, value: bytes) -> bytes:
        """The same."""
        return value

    def decode(self, payload: bytes) -> bytes:
        """The same."""
        return payload

    def __len__(self) -> int:
        raise udsoncan.DidCodec.ReadAllRemainingData


def is_answer(request: bytes, message: bytes) -> bool:
    """Whether a message answers this request, as far as its first bytes tell."""
    if message[:1] == bytes([NEGATIVE]):
        return message[1:2] == request[:1]
    if not message or message[0] != request[0] + POSITIVE:
        return False
    if request[0] == ROUTINE_CONTROL:
        return message[1:4] == request[1:4] and message[KEY_ECHO] == request[KEY_AT]
    echoed = ECHOED.get(request[0])
    return echoed is None or message[echoed] == request[echoed]
