"""FMUs as components: the one place that knows FMPy."""

from inkloop.fmu.component import FmuComponent, archive_error, platform_error
from inkloop.fmu.description import FmuDescription
from inkloop.fmu.reading import describe
from inkloop.fmu.variable import Variable

__all__ = ["FmuComponent", "FmuDescription", "Variable", "archive_error", "describe", "platform_error"]
