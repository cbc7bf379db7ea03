"""The OpenCL devices of this machine, and the one that searches plans."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

import pyopencl as cl

from inkloop.errors import InkloopError

CHOICE = "PYOPENCL_CTX"
"""Environment variable of pyopencl that names another device than the GPU with the most memory."""


class DeviceError(InkloopError):
    """There is no device, it lacks something, or it has failed."""


def devices() -> list[cl.Device]:
    """All OpenCL devices, processors included."""
    try:
        return [device for platform in cl.get_platforms() for device in platform.get_devices()]
    except cl.Error:  # no platform at all
        return []


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
            f"no GPU here, but {others}; install the OpenCL driver of the GPU, or plan on the processor with device = "
            f"'cpu' ({CHOICE} takes another device)"
        )
    device = max(found, key=lambda device: device.global_mem_size)
    if not device.double_fp_config:
        raise DeviceError(f"{described(device)} has no double precision, which the search needs: device = 'cpu'")
    return device


@contextmanager
def device_errors(where: str) -> Iterator[None]:
    """Turn errors of OpenCL within the block into DeviceError."""
    try:
        yield
    except (cl.Error, cl.LogicError) as error:
        reason = str(error).strip().splitlines()[0]
        raise DeviceError(
            f"{where} has failed ({reason}); plan on the processor with device = 'cpu', or 'auto', which goes on there"
        ) from error
