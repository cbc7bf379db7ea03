"""The OpenCL devices of this machine, and the one that searches plans."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache

import pyopencl as cl

from inkloop.errors import InkloopError

CHOICE = "PYOPENCL_CTX"
"""Environment variable of pyopencl that names another device than the GPU with the most memory."""


class DeviceError(InkloopError):
    """There is no device, it lacks something, or it has failed."""


def devices() -> list[cl.Device]:
    """All OpenCL devices, processors included."""
    found: list[cl.Device] = []
    with suppress(cl.Error):  # no platform at all
        for platform in cl.get_platforms():
            with suppress(cl.Error):  # a driver that is broken
                found += platform.get_devices()
    return found


def described(device: cl.Device) -> str:
    """Name, platform and memory."""
    kind = "GPU" if device.type & cl.device_type.GPU else "processor"
    return f"{device.name.strip()} ({kind}, {device.platform.name.strip()}, {device.global_mem_size / 2**30:.1f} GiB)"


def lines() -> list[str]:
    """All devices, and the one that `device = "gpu"` takes."""
    try:
        taken = f'device = "gpu" takes {described(chosen_device())}'
    except DeviceError as error:
        taken = str(error)
    return [*map(described, devices()), taken]


@cache
def chosen_device() -> cl.Device:
    """The GPU with the most memory, or the device that the environment names. Raises DeviceError for none."""
    if os.environ.get(CHOICE):
        with device_errors(f"the device of {CHOICE}={os.environ[CHOICE]}"):
            found = cl.create_some_context(interactive=False).devices
    else:
        found = [device for device in devices() if device.type & cl.device_type.GPU]
    if not found:
        others = ", ".join(map(described, devices())) or "no OpenCL device at all"
        raise DeviceError(
            f"no GPU here, but {others}; install the OpenCL driver of the GPU ({CHOICE} takes another device)"
        )
    device = max(found, key=lambda device: device.global_mem_size)
    if "cl_khr_fp64" not in device.extensions.split():
        raise DeviceError(f"{described(device)} has no double precision, which the search needs")
    return device


@contextmanager
def device_errors(where: str) -> Iterator[None]:
    """Turn errors of OpenCL within the block, and missing memory, into DeviceError."""
    try:
        yield
    except (cl.Error, MemoryError) as error:
        lines = str(error).splitlines() or ["no memory"]
        log = [line for line in lines[1:] if "error" in line.lower()]  # of a compiler, which may be long
        reason = ": ".join([lines[0], *log[:1]])
        raise DeviceError(
            f"{where} has failed ({reason}); plan on the processor with device = 'cpu', or let 'auto' change to it"
        ) from error
