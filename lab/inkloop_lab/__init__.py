"""Studies of prints: what is done with many of them, or around one, and not what prints.

    import inkloop_lab

    env = inkloop_lab.LayerEnv("scenarios/cuboid.toml")     # a scenario as an environment of Gymnasium

`inkloop_lab.models` has the deposition models as functions of arrays. The commands `identify`, `reproduce`, `score` and
`sweep` and the kind "env:module:Class" come into inkloop by entry points. Everything here builds on public names of
inkloop; nothing of inkloop imports it.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from inkloop_lab.environment.layer_env import LayerEnv
    from inkloop_lab.identify.print_record import IdentificationError

_MODULES = {
    "inkloop_lab.environment.layer_env": ("LayerEnv",),
    "inkloop_lab.identify.print_record": ("IdentificationError",),
}
"""Module -> public names that are imported from it when they are first used."""

__all__ = ["IdentificationError", "LayerEnv"]

if not TYPE_CHECKING:  # for mypy the names are those above, and nothing else is there

    def __getattr__(name: str) -> Any:
        module = next((module for module, names in _MODULES.items() if name in names), None)
        if module is None:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        globals()[name] = getattr(import_module(module), name)
        return globals()[name]

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})
