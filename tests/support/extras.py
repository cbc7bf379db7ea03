"""Commands that need a package of an extra, and what a base installation says of them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from inkloop.errors import EXTRAS
from inkloop.fmu_writer.targets import TARGETS
from support.places import SCENARIOS

RUN = "RUN"
Words = tuple[str, ...]
COMMANDS: Mapping[str, tuple[Words, ...]] = {
    "contourpy": (("metrology", RUN),),
    "lib3mf": (("validate", str(SCENARIOS / "two-ink-3mf.toml")),),
    "matplotlib": (
        ("report", RUN),
        ("report", RUN, "--pdf"),
        ("compare", RUN, RUN),
        ("geometry", str(SCENARIOS / "cuboid.toml")),
        ("export", "job", str(SCENARIOS / "cuboid.toml")),
        ("score", "--quick"),
        ("reproduce", "lu", "--quick"),
    ),
    "odxtools": (("export", "services", "nodes.pdx"),),
    "optuna": (("sweep", str(SCENARIOS / "studies/tune-for-no-flow.toml"), "--check"),),
    "PIL": (
        ("export", "layers", RUN),
        ("metrology", "map.png"),
        ("metrology", "map.bmp"),
        ("validate", str(SCENARIOS / "lithophane.toml")),
    ),
    "plotly": (("report", RUN, "--html"), ("watch", RUN)),
    "sdfio": (("export", "surface", RUN, "--format", "sdf"), ("metrology", "map.sdf")),
    "SurfaceTopography": (("metrology", "map.x3p"), ("metrology", "map.sur")),
    "tifffile": (("export", "surface", RUN, "--format", "tiff"), ("metrology", "map.tif")),
    "trimesh": (
        ("geometry", "map.ply", "--unit", "mm"),
        ("new", "part", "--part", "map.ply"),
        ("export", "surface", RUN, "--format", "stl"),
        ("export", "surface", RUN, "--format", "glb"),
    ),
    "ziglang": (("export", "fmu", "ProfileSensor", "--platforms", next(name for name in TARGETS if "darwin" in name)),),
}
"""Library -> commands that need it; RUN stands for the folder of a run of the cylinder."""
REST_IS_DONE: frozenset[Words] = frozenset(
    {
        *COMMANDS["contourpy"],
        *(words for words in COMMANDS["matplotlib"] if words[0] in ("report", "compare", "geometry", "export")),
    }
    - {("report", RUN, "--pdf")}
)
"""Commands that do the rest without the library, and say in one line what is left out."""


def sentence(library: str) -> str:
    """End of a message that names the package and its extra."""
    package, extra = EXTRAS[library]
    return f"needs the package {package}: pip install 'inkloop[{extra}]'"


def write_maps(folder: Path) -> None:
    """Files of the formats of COMMANDS; their libraries are looked for before they are read."""
    for suffix in ("png", "bmp", "sdf", "x3p", "sur", "tif", "ply"):
        (folder / f"map.{suffix}").write_bytes(b"content")
