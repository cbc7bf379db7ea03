"""FMUs as components: the one place that knows FMPy."""

from inkloop.fmu.component import FmuComponent, platform_fault
from inkloop.fmu.description import FmuDescription
from inkloop.fmu.reading import describe
from inkloop.fmu.variable import Variable

__all__ = ["FmuComponent", "FmuDescription", "Variable", "describe", "platform_fault"]
