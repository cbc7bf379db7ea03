"""What components put out and saved at a checkpoint, read from its file where it is used.

A print that resumes would else hold all of it in memory, beside what the components make of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from inkloop.component import Values
from inkloop.results import array_file


class StoredStates(Mapping[str, bytes]):
    """States of components in a file, each read when it is asked for: a print that resumes holds none of them."""

    def __init__(self, path: Path, components: list[str]) -> None:
        self._path, self._components = path, components

    def __getitem__(self, component: str) -> bytes:
        if component not in self._components:
            raise KeyError(component)
        return array_file.bytes_of(self._path, f"state/{component}")

    def __iter__(self) -> Iterator[str]:
        return iter(self._components)

    def __len__(self) -> int:
        return len(self._components)


class StoredOutputs(Mapping[str, Values]):
    """Outputs of components in a file, as `StoredStates`; a component may have none."""

    def __init__(self, path: Path, ports: Mapping[str, list[str]]) -> None:
        self._path, self._ports = path, ports

    def __getitem__(self, component: str) -> Values:
        with array_file.opened(self._path) as stored:
            outputs = {port: stored[f"output/{component}/{port}"] for port in self._ports[component]}
        for value in outputs.values():
            value.flags.writeable = False  # consumers share it
        return outputs

    def __iter__(self) -> Iterator[str]:
        return iter(self._ports)

    def __len__(self) -> int:
        return len(self._ports)
