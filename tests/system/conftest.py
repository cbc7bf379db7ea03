"""Bus processes of the tests in this folder are forked."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from inkloop_hardware.bus import connection
from support.benches import forked_bus


@pytest.fixture(scope="session", autouse=True)
def forked_bus_processes() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(connection, "subprocess", forked_bus.patched())
        yield
