"""Maps of a grid on an OpenCL device, which stay there from plan to plan."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray


class DeviceMaps:
    """Buffers by name: maps of one grid with a frame of one cell, and small arrays. They grow with the horizon alone.

    sent: bytes so far.
    """

    def __init__(self, queue: cl.CommandQueue, shape: tuple[int, int]) -> None:
        self.queue, self.shape = queue, shape
        self.sent = 0
        self._buffers: dict[str, cl.Buffer] = {}
        self._known: dict[str, NDArray[Any]] = {}

    def room(self, name: str, layers: int, dtype: Any, frame: float = 0.0) -> cl.Buffer:
        """Room for so many maps of this dtype; new room holds the value of the frame everywhere."""
        kind = np.dtype(dtype)
        size = layers * (self.shape[0] + 2) * (self.shape[1] + 2) * kind.itemsize
        is_new = self._grow(name, size)
        if is_new:
            cl.enqueue_fill_buffer(self.queue, self._buffers[name], kind.type(frame), 0, size)
        return self._buffers[name]

    def put(self, name: str, maps: NDArray[Any], *, stays: bool = False) -> cl.Buffer:
        """Send maps ((layers,) nx, ny); those that stay mostly the same only where they are not the last ones."""
        given = maps.reshape(-1, *self.shape)
        buffer = self.room(name, len(given), given.dtype)
        known = self._known.get(name, given[:0])
        if stays and len(known) >= len(given) and np.array_equal(known[: len(given)], given):
            return buffer
        self._known.pop(name, None)
        cl.enqueue_copy(self.queue, buffer, np.ascontiguousarray(given), **self._places(given))
        self.sent += given.nbytes
        if stays:
            self._known[name] = given.copy()
        return buffer

    def read(self, name: str, layers: int, dtype: Any) -> NDArray[Any]:
        """The first maps of a buffer (layers, nx, ny)."""
        found = np.empty((layers, *self.shape), dtype)
        cl.enqueue_copy(self.queue, found, self._buffers[name], **self._places(found))
        return found

    def small(self, name: str, values: NDArray[Any]) -> cl.Buffer:
        """Send an array that is no map."""
        self._grow(name, values.nbytes)
        cl.enqueue_copy(self.queue, self._buffers[name], values)
        self.sent += values.nbytes
        return self._buffers[name]

    def release(self) -> None:
        """Give the memory back."""
        while self._buffers:
            self._buffers.popitem()[1].release()
        self._known.clear()

    def _grow(self, name: str, size: int) -> bool:
        """Whether the buffer is new: there was none, or a smaller one."""
        if name in self._buffers:
            if self._buffers[name].size >= size:
                return False
            self._known.pop(name, None)
            self._buffers.pop(name).release()
        self._buffers[name] = cl.Buffer(self.queue.context, cl.mem_flags.READ_WRITE, size)
        return True

    def _places(self, maps: NDArray[Any]) -> dict[str, Any]:
        """Where maps here, and framed ones on the device, begin, and how long their rows and maps are [bytes]."""
        (layers, nx, ny), bytes_ = maps.shape, maps.itemsize
        stride = (ny + 2) * bytes_
        return {
            "buffer_origin": (bytes_, 1, 0),
            "host_origin": (0, 0, 0),
            "region": (ny * bytes_, nx, layers),
            "buffer_pitches": (stride, (nx + 2) * stride),
            "host_pitches": (ny * bytes_, nx * ny * bytes_),
        }
