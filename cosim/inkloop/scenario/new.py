"""A scenario to start from: small, complete, every optional table there as a comment."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from inkloop.errors import ScenarioError
from inkloop.files import write_text

PARTS: Mapping[str, str] = {
    "cylinder": """\
radius_um = 1579.536   # 6 droplet pitches
height_um = 76.0       # 10 full layers""",
    "cuboid": """\
size_x_um = 2632.56    # 10 droplet pitches
size_y_um = 2632.56
height_um = 76.0       # 10 full layers""",
    "staircase": """\
size_x_um = 3159.072   # 12 droplet pitches, all steps together
size_y_um = 2632.56
height_um = 76.0       # of the last step: 10 full layers
steps = 3""",
    "pipe-junction": """\
outer_across_um = 1579.536    # half-axes of the outer wall, in the plane and along z
outer_upright_um = 36.0
inner_across_um = 1053.024    # half-axes of the bore
inner_upright_um = 24.0
height_um = 76.0

[support]          # ink B fills the block around the part
margin_cells = 2""",
}
"""Shape -> the keys of its part."""

SUPPORT_COMMENT = """\

# [support]          # ink B fills the block around the part
# margin_cells = 2
"""

TEMPLATE = """\
# {title}: what is printed, and why.
#
# What to look at: ...
#
# `inkloop validate {file}` names every error, `inkloop run {file}` prints it. Lengths are in um.
title = "{title}"
label = "closed loop"   # name of the run in the table and in legends
seed = 1                # the same seed prints the same droplets

[grid]
nx = 16
ny = 16
# pitch_um = 263.256   # droplet spacing

[part]
shape = "{shape}"
# center_x_um = 1974.42   # default: the middle of the grid
# center_y_um = 1974.42
{part}
{support}
# [substrate]          # an uneven surface to print on; only the printer knows it
# tilt_x = 0.002
# tilt_y = 0.0
# step_um = 10.0
# wave_um = 5.0
# wavelength_um = 3000.0
# roughness_um = 1.0

# [ink.a]              # height that a droplet adds to its cell, a side and a corner neighbour
# h1_um = 4.4
# h2_um = 0.6
# h3_um = 0.2

# [ink.b]
# h1_um = 4.4
# h2_um = 0.6
# h3_um = 0.2

# [process]
# passes = 1           # 4: a 2 x 2 colouring with cure between the passes
# pass_order = "raster"
# pass_rotation = 0

# [run]
# step_s = 1.0
# algorithm = "gauss-seidel"   # or "jacobi"
# layers_max = 1000
# time_max_s = 3600.0
# real_time_factor = 1.0       # left out: as fast as possible

# [bench]                      # kind = "hardware.printer" and "hardware.profiler": a bench on a CAN bus
# interface = "slcan"
# channel = "/dev/ttyACM0"
# bitrate = 500000
# cure_ms = 100

[components.controller]   # the order of the components is that of a step
kind = "LayerMpc"         # or "OpenLoop", "CohenLipson", "ErrorDiffusion", "StochasticGreedy"
alpha = 0.8               # weight of the mean error against the standard deviation
horizon = 3               # layers ahead, 1 to 5
# overshoot = 1.0         # what a um too high costs when one too low costs 1
# overshoot_limit_um = 2.0
# drop_levels = 4         # a grey head: 1 to 4 drops at once
# dead_nozzles = [5]
# nozzle_pitch = 16       # nozzles of the head
# adapt_ink = "scale"     # what is learnt of the ink: its volume; or "full", "off"
# time_limit_s = 2.0      # guard by the clock for each layer

[components.printer]
kind = "LayerDeposition"
variation = 0.2           # up to this share of a droplet's volume is missing
variation_kind = "per_droplet"

[components.profiler]
kind = "ProfileSensor"
preset = "exact"          # or "laser", "zeta-20"

# [[connections]]         # in place of the contract's wire to that input
# source = "printer.height"
# target = "profiler.height"
# gain = 1.0

# [[events]]              # from a layer or a time on
# at_layer = 5
# action = "override"     # or "bias", "reset"
# port = "printer.pattern"
# value = 0
# cells = [[8, 8]]

[compare."open loop".components.controller]   # the same job with another component
kind = "OpenLoop"

# [literature."where from"]   # published figures to show next to the results
# mean_error_um = 0.7
# std_um = 4.1
# note = "another plant"
"""


def write(name: Path, shape: str) -> Path:
    """Write NAME.toml with a part of that shape; returns its path. Raises ScenarioError, overwrites nothing."""
    path = name if name.suffix == ".toml" else name.with_name(f"{name.name}.toml")
    if path.exists():
        raise ScenarioError(str(path), ["is there already and is not overwritten; choose another name"])
    title = path.stem.replace("-", " ").replace("_", " ").replace('"', "'").capitalize()
    support = "" if "[support]" in PARTS[shape] else SUPPORT_COMMENT
    text = TEMPLATE.format(title=title, file=path.name, shape=shape, part=PARTS[shape], support=support)
    try:
        write_text(path, text)
    except OSError as error:
        raise ScenarioError(str(path), [f"cannot be written: {error.strerror}"]) from error
    return path
