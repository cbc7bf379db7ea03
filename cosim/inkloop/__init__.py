"""inkloop: closed-loop ink-jet 3D printing as a co-simulation of FMUs, a layer controller and hardware."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("inkloop")
except PackageNotFoundError:  # the build runs parts of the package before it is installed
    __version__ = "0"
