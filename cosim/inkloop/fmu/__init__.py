"""FMUs as components: the one place that knows FMPy."""

from inkloop.fmu.component import FmuComponent, archive_fault, platform_fault
from inkloop.fmu.description import FmuDescription
from inkloop.fmu.reading import describe
from inkloop.fmu.variable import Variable

__all__ = ["FmuComponent", "FmuDescription", "Variable", "archive_fault", "describe", "platform_fault"]
