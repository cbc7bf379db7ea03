"""A machine with SocketCAN where the host has none: the kernel of user-mode Linux, a process without any privilege.

Its root is that of the host, read-only; one folder can be written, under the same path on both sides.
"""

from __future__ import annotations

import os
import shlex
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

from support import compiled
from support.places import C_SOURCES

KERNEL = "linux.uml"
PROGRAMS = (KERNEL, "insmod", "ip", "slcand", "cangw", "cangen")
"""Debian's user-mode-linux, kmod, iproute2 and can-utils."""
SYSTEM_PATH = "/usr/local/bin:/usr/sbin:/sbin:/usr/bin:/bin"
MODULES = (
    *("net/can/can", "net/can/can-raw", "net/can/can-bcm", "net/can/can-gw", "drivers/net/can/dev/can-dev"),
    *("drivers/net/can/vcan", "drivers/net/can/vxcan", "drivers/net/can/slcan/slcan"),
)
INIT = """#!/bin/sh
export PATH={path} HOME={folder} TMPDIR={folder}
mount -t proc proc /proc && mount -t sysfs sysfs /sys && mkdir /dev/pts && mount -t devpts devpts /dev/pts
mount -t hostfs -o {folder} none {folder}
for module in {modules}; do insmod /usr/lib/uml/modules/$(uname -r)/kernel/$module.ko; done
ip link set lo up
cd {at} && {command}
echo $? >{folder}/exit.txt
sync
exec {python} -c 'import ctypes; ctypes.CDLL(None).reboot(0x4321FEDC)'  # power off
"""


def missing_programs() -> list[str]:
    """Programs that the guest needs and this machine lacks."""
    return [name for name in PROGRAMS if shutil.which(name, path=f"{os.environ['PATH']}:{SYSTEM_PATH}") is None]


def _whole_xstate() -> Path:
    """The library without which the kernel panics on a processor with AMX."""
    made = compiled.object_of(C_SOURCES / "whole_xstate.c", ("-std=gnu11", "-O1", "-fPIC"))
    return compiled.linked("whole_xstate.so", [made], ("-shared",))


def run_in_guest(command: Sequence[str], folder: Path, at: Path, python: str, limit_s: float) -> tuple[int | None, str]:
    """Boot, run a command in the folder `at` and power off: its exit code, None without one, and the console.

    folder: what the command may write to; python: that of the command; limit_s: until the guest is killed.
    """
    init = folder / "init"
    words = {"folder": shlex.quote(str(folder)), "at": shlex.quote(str(at)), "python": shlex.quote(python)}
    text = INIT.format(path=SYSTEM_PATH, modules=" ".join(MODULES), command=shlex.join(command), **words)
    init.write_text(text, encoding="utf-8")
    init.chmod(0o755)
    with tempfile.TemporaryDirectory(prefix="inkloop-uml-") as sockets:  # a short path, as a socket needs it
        kernel = [KERNEL, "mem=1G", "rootfstype=hostfs", "rootflags=/", "ro", f"init={init}", f"uml_dir={sockets}"]
        guest = subprocess.Popen(
            [*kernel, "con=null", "con0=null,fd:1", "quiet"],
            env=os.environ | {"LD_PRELOAD": str(_whole_xstate())},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,
        )
        try:
            console = guest.communicate(timeout=limit_s)[0]
        except subprocess.TimeoutExpired:
            os.killpg(guest.pid, signal.SIGKILL)
            console = guest.communicate()[0] + f"\nThe guest did not end within {limit_s:g} s"
    code = folder / "exit.txt"
    return (int(code.read_text()) if code.exists() else None), console
