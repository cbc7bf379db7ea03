"""The Modelica library and the FMUs are the same models: same patterns, same surfaces, same readings."""

from __future__ import annotations

import csv
import re
import tomllib
from typing import Any

import numpy as np
import pytest
import rumoca

from support.fmus.fmu_driver import OK, Driver, random_patterns
from support.fmus.modelica_library import LIBRARY, compiled, literal, reference_file, simulate_text
from support.long_proofs import rest_is_long
from support.numpy import lu_numpy, sensor_numpy, wu_chiu_numpy
from support.numpy.philox_numpy import normal, philox, uniforms

pytestmark = pytest.mark.system
SHAPE = NX, NY = 5, 4
START = np.random.default_rng(1).uniform(0.0, 10e-6, SHAPE)
INKS = "ink_a(h1=4.4e-6, h2=0.6e-6, h3=0.2e-6), ink_b(h1=3e-6, h2=0.9e-6, h3=0.3e-6)"
LAYERS = 4


def printed(block: str, layers: int = LAYERS) -> tuple[str, np.ndarray]:
    """The text of a model that prints random patterns, one per second, and the patterns."""
    patterns = np.array(list(random_patterns(NX, NY, layers)))
    text = f"""model M
      InkLoop.Control.PatternSequence controller(patterns={literal(patterns)});
      {block};
    equation
      connect(controller.pattern, deposition.pattern);
      connect(controller.layer_command, deposition.layer_command);
    end M;"""
    return text, patterns


def lu(modifiers: str) -> str:
    return (
        f"InkLoop.Deposition.LayerDeposition deposition(nx={NX}, ny={NY}, height_start={literal(START)}, {modifiers})"
    )


SET_IN_THE_MODEL = {"nx", "ny", "scan_duration", "cap_radius"}


@pytest.mark.parametrize(
    ("model", "part", "fmu"),
    [
        ("Validation.CuboidFourLayers", "deposition", "layer_deposition"),
        ("Validation.VolumeAreaBalance", "deposition", "volume_area_deposition"),
        ("Examples.CuboidOpenLoop", "sensor", "profile_sensor"),
    ],
)
def test_parameters_have_the_names_units_and_values_of_the_fmu(model, part, fmu) -> None:
    variables = tomllib.loads((LIBRARY.parents[1] / "fmus" / fmu / "variables.toml").read_text())["variables"]
    ours = [found for found in compiled(model).parameters if found.name.startswith(f"{part}.")]
    assert len(ours) >= 14
    for parameter in ours:
        name = parameter.name.removeprefix(f"{part}.")
        if name == "cap":
            continue
        theirs = variables[re.sub(r"ink_(.)\.(h\d)", r"\2_\1", name)]
        assert (parameter.unit or "1") == theirs.get("unit", "1"), name
        if name not in SET_IN_THE_MODEL and not parameter.dims:
            assert parameter.value == theirs["start"], name


TWO_INKS = {"h1_b": 3e-6, "h2_b": 0.9e-6, "h3_b": 0.3e-6}
CHANCE = {"seed": 77, "variation": 0.4, "nozzle_pitch": 3, "nozzle_variation": 0.2}
CHANCE_OF_THE_LIBRARY = ", ".join(f"{name}={value}" for name, value in CHANCE.items())
PRINTS: list[tuple[str, dict[str, Any]]] = [
    *(
        (
            f"{INKS}, passes={passes}, pass_order=InkLoop.Types.PassOrder.{order}, pass_rotation={rotation}",
            {**TWO_INKS, "passes": passes, "pass_order": number, "pass_rotation": rotation},
        )
        for passes, order, number, rotation in ((1, "raster", 1, 0), (4, "diagonal", 2, 1), (4, "raster", 1, 3))
    ),
    *(
        (
            f"{CHANCE_OF_THE_LIBRARY}, variation_kind=InkLoop.Types.VariationKind.{kind}",
            {**CHANCE, "variation_kind": number},
        )
        for kind, number in (("per_droplet", 1), ("per_cell_and_layer", 4))
    ),
]


@pytest.mark.parametrize(("modifiers", "parameters"), PRINTS)
def test_layers_are_those_of_the_fmu(modifiers, parameters) -> None:
    text, patterns = printed(lu(modifiers))
    run = simulate_text(text, LAYERS + 0.9)
    with Driver("LayerDeposition", "fmi3", NX, NY).start({**parameters, "height_start": START}) as fmu:
        for layer, pattern in enumerate(patterns, start=1):
            surface = fmu.print_layer(pattern)
            assert run.at("deposition.layers_printed", layer + 0.5) == layer
            assert run.at("deposition.height", layer + 0.5, SHAPE) == pytest.approx(surface, rel=1e-12, abs=0.0)
            for name in ("volume_lost", "height_mean", "droplets_a", "droplets_b"):
                assert run.at(f"deposition.{name}", layer + 0.5) == pytest.approx(fmu.get(name), rel=1e-12, abs=0.0)


@pytest.mark.parametrize(
    "own",
    [
        pytest.param({}, marks=pytest.mark.long),
        pytest.param({"guard": True, "cap_radius": 120e-6}, marks=pytest.mark.long),
        {"seed": 5, "variation": 0.3, "nozzle_pitch": 3, "nozzle_variation": 0.2, "height_start": START},
    ],
    ids=["nominal", "guard", "uneven start and random volumes"],
)
def test_volume_and_area_are_those_of_the_fmu(own) -> None:
    """Heights to 1e-12 of the tallest cell: v / a with a small area makes rounding grow, in a by ma_minus once more."""
    modifiers = "".join(
        f", {name}={literal(np.asarray(value)[()])}".replace("True", "true") for name, value in own.items()
    )
    block = f"InkLoop.Deposition.VolumeAreaDeposition deposition(nx={NX}, ny={NY}{modifiers})"
    text, patterns = printed(block, layers=2)
    run = simulate_text(text, 2.9)
    with Driver("VolumeAreaDeposition", "fmi3", NX, NY).start(own) as fmu:
        for layer, pattern in enumerate(patterns, start=1):
            surface = fmu.print_layer(pattern)
            assert run.at("deposition.height", layer + 0.5, SHAPE) == pytest.approx(
                surface, rel=0.0, abs=1e-12 * surface.max()
            )
            assert run.at("deposition.area", layer + 0.5, SHAPE) == pytest.approx(fmu.get("area"), rel=0.0, abs=1e-11)


def on_disc(cells: int, radius: float) -> np.ndarray:
    """1 on a disc in the middle of the grid, as `Functions.cylinder`."""
    along = np.arange(cells) - 0.5 * (cells - 1)
    return (np.hypot(*np.meshgrid(along, along)) <= radius).astype(int)


PRINTED_EXAMPLES: dict[str, tuple[str, np.ndarray, int, dict[str, Any]]] = {
    "CuboidOpenLoop": ("LayerDeposition", np.ones((9, 9), int), 4, {}),
    "CylinderOpenLoop": (
        "LayerDeposition",
        on_disc(11, 4.0),
        6,
        {"nozzle_pitch": 5, "nozzle_variation": 0.4, "seed": 1},
    ),
    "TwoMaterials": (
        "LayerDeposition",
        np.repeat([[1] * 4 + [2] * 4], 8, axis=0),
        3,
        {"h1_b": 3e-6, "h2_b": 0.9e-6, "h3_b": 0.3e-6, "passes": 4, "pass_order": 2, "pass_rotation": 1},
    ),
    "VolumeAreaSquare": ("VolumeAreaDeposition", np.pad(np.ones((5, 5), int), 2), 2, {"guard": True}),
}


@pytest.mark.parametrize("example", PRINTED_EXAMPLES)
def test_reference_results_end_with_the_surface_of_the_fmu(example) -> None:
    """Those of the examples in open loop, whose patterns are known; no Modelica tool takes part."""
    model, pattern, layers, parameters = PRINTED_EXAMPLES[example]
    with reference_file(f"Examples.{example}").open(newline="") as file:
        last = list(csv.DictReader(file))[-1]
    with Driver(model, "fmi3", *pattern.shape).start(parameters) as fmu:
        for _ in range(layers):
            surface = fmu.print_layer(pattern)
        cells = [name for name in last if name.startswith("deposition.height[")]
        assert len(cells) >= 6
        for name in cells:
            i, j = map(int, re.findall(r"\d+", name))
            assert float(last[name]) == pytest.approx(surface[i - 1, j - 1], rel=0.0, abs=1e-12 * surface.max()), name
        for name in ("height_mean", "droplets_a"):
            assert float(last[f"deposition.{name}"]) == pytest.approx(fmu.get(name), rel=1e-12, abs=0.0)


SET_UPS = [
    {"shift_x": 400e-6, "shift_y": -600e-6},
    {"resolution": 0.5e-6, "bias": 2e-6, "drift_rate": 0.7e-6, "tilt_x": 1e-3, "tilt_y": -2e-3},
    {
        "spot_radius": 200e-6,
        "shift_x": -90e-6,
        "shift_y": 450e-6,  # beyond the end of the shorter side, before that of the longer one
        "shift_std": 30e-6,
        "slope_bias": 3e-6,
        "dropout_slope": 0.006,
    },
    {"noise_std": 1e-6, "noise_correlation": 0.3, "dropout_rate": 0.3, "seed": 4},
]


@pytest.mark.parametrize("own", rest_is_long(SET_UPS, 3), ids=["other side", "set-up", "optics", "chance"])
def test_readings_are_those_of_the_fmu(own) -> None:
    modifiers = "".join(f", {name}={value!r}" for name, value in own.items())
    text, patterns = printed(lu(INKS), layers=1)
    sensor = f"""
      InkLoop.Sensors.ProfileSensor sensor(nx={NX}, ny={NY}, scan_duration=0.25{modifiers});
    equation
      connect(deposition.height, sensor.height);
      connect(deposition.layers_printed, sensor.layers_printed);"""
    run = simulate_text(text.replace("equation", sensor), len(patterns) + 0.9)
    with Driver("ProfileSensor", "fmi3", NX, NY).start({"scan_duration": 0.0, **own}) as fmu:
        for layer in range(len(patterns) + 1):
            surface = run.at("deposition.height", layer + 0.5, SHAPE)
            assert max(fmu.set("height", surface), fmu.set("layers_printed", layer)) == OK
            assert fmu.step(float(layer)) == OK
            assert run.at("sensor.layers_scanned", layer + 0.2) == layer - 1
            assert run.at("sensor.layers_scanned", layer + 0.5) == layer
            assert np.array_equal(run.at("sensor.valid", layer + 0.5, SHAPE), fmu.get("valid"))
            reading = run.at("sensor.measured_height", layer + 0.5, SHAPE)
            assert reading == pytest.approx(fmu.get("measured_height"), rel=1e-12, abs=1e-19)


SMALL = (3, 2)


def found_at_once(variables: str, statement: str) -> Any:
    """A run in which a function of the library is called once."""
    return simulate_text(f"model M {variables} algorithm when sample(0.25, 1) then {statement} end when; end M;", 0.9)


def small_map(name: str, kind: str = "discrete Real", start: str = "0") -> str:
    return f"{kind} {name}[3, 2](each start={start}, each fixed=true);"


@pytest.mark.parametrize(("kind", "number"), [("per_cell", 2), ("per_layer", 3)])
def test_factors_of_cells_and_of_layers_are_those_of_numpy(kind: str, number: int) -> None:
    call = f"InkLoop.Functions.volumeFactors(3, 2, 4, 77, 0.4, InkLoop.Types.VariationKind.{kind}, 1, 0)"
    run = found_at_once(small_map("factor"), f"factor := {call};")
    expected = lu_numpy.factors(SMALL, 4, seed=77, variation=0.4, kind=number)
    assert run.at("factor", 0.5, SMALL) == pytest.approx(expected, rel=1e-14, abs=0.0)


def test_readings_that_chance_takes_or_alters_are_those_of_numpy() -> None:
    """Of six two are lost by their slopes, and another by chance."""
    height = np.array([[1.0, 2.0], [3.0, 5.0], [4.0, 9.0]]) * 1e-6
    chance = {"seed": 3, "noise_std": 1e-6, "noise_correlation": 0.3, "dropout_rate": 0.4, "dropout_slope": 0.016}
    numbers = "{noise_std}, {noise_correlation}, {dropout_rate}, {dropout_slope}".format(**chance)
    call = (
        f"InkLoop.Functions.readSurface({literal(height)}, fill(7e-6, 3, 2), 3, 263.256e-6, {{0, 0}}, 0, 0, 0, "
        f"{numbers}, {{0, 0}}, 0, 0, {chance['seed']})"
    )
    variables = small_map("reading") + small_map("valid", "Boolean", "false")
    run = found_at_once(variables, f"(reading, valid) := {call};")
    reading, valid = sensor_numpy.scan(height, 3, **chance)  # type: ignore[arg-type]
    by_slope = sensor_numpy.slope(height, 263.256e-6) > 0.016
    assert (by_slope.sum(), valid.sum()) == (2, 3)
    assert np.array_equal(run.at("valid", 0.5, SMALL), valid)
    assert run.at("reading", 0.5, SMALL) == pytest.approx(np.where(valid, reading, 7e-6), rel=1e-12, abs=0.0)


def test_halves_are_rounded_to_even_multiples() -> None:
    halves = (-0.75, -0.25, 0.25, 0.75, 1.25, 0.3)
    assigned = "".join(f"r[{k}] := InkLoop.Functions.roundToMultiple({x}, 0.5); " for k, x in enumerate(halves, 1))
    run = found_at_once("discrete Real r[6](each start=0, each fixed=true);", assigned)
    assert [run.at(f"r[{k}]", 0.5) for k in range(1, 7)] == [-1.0, 0.0, 0.0, 1.0, 1.0, 0.5]


@pytest.mark.parametrize("guard", [False, True])
@pytest.mark.parametrize(("cell", "ma_plus"), [((1, 0), -4e4), ((2, 1), 3e4)])
def test_drop_beside_covered_cells_is_that_of_numpy(cell: tuple[int, int], ma_plus: float, guard: bool) -> None:
    """Cells higher and lower than their surroundings, a bare one, and areas that would leave 0 to 1."""
    substrate = np.array([[0.0, 1.0], [0.5, 0.0], [2.0, 0.0]])
    v, a = np.array([[1.0, 0.8], [0.2, 0.0], [1.5, 0.1]]), np.array([[0.9, 0.3], [0.4, 0.0], [1.0, 0.02]])
    height = 1e-6 * (substrate + 7.0751 * v)
    call = (
        f"InkLoop.Functions.volumeAreaDrop({literal(height)}, {literal(a)}, {literal(1e-6 * substrate)}, "
        f"{cell[0] + 1}, {cell[1] + 1}, {0.9 * 7.0751e-6!r}, {{6700, -20100, {ma_plus}, -63400}}, "
        f"fill(0.1, 2, 3), {str(guard).lower()})"
    )
    run = found_at_once(small_map("height") + small_map("area"), f"(height, area) := {call};")
    none = (np.full((3, 3), 0.1), np.full((3, 3), 0.1))
    wu_chiu_numpy.drop(v, a, substrate, *cell, 0.9, none, guard=guard, ma_plus=1e-6 * ma_plus)
    assert run.at("area", 0.5, SMALL) == pytest.approx(a, rel=1e-9, abs=1e-12)
    expected = 1e-6 * (substrate + 7.0751 * v)
    assert run.at("height", 0.5, SMALL) == pytest.approx(expected, rel=1e-9, abs=0.0)


@pytest.mark.parametrize(("layers_max", "last"), [(9, "{{4.5, 8, 0, 9}}"), (1, "{{0, 0, 0, 0}}")])
def test_threshold_is_half_a_layer_and_the_print_ends_where_nothing_is_missing(layers_max: int, last: str) -> None:
    """Or after so many layers; a scan is answered only where it is the newest layer's. Heights in metres, exact."""
    text = f"""model M
      InkLoop.Control.ThresholdFeedback controller(
        nx=1, ny=4, layers_max={layers_max}, material={{{{1, 2, 0, 1}}}}, target_height=fill(8, 1, 4), layerHeight=8);
      discrete Real height[1, 4](each start=4, each fixed=true);
      Integer scanned(start=-1, fixed=true);
      Integer printed(start=0, fixed=true);
    equation
      controller.measured_height = height;
      controller.valid = fill(true, 1, 4);
      controller.layers_scanned = scanned;
      controller.layers_printed = printed;
    algorithm
      when sample(0.5, 0.5) then
        scanned := if time > 3.9 then 1 elseif time > 0.9 then 0 else -1;
        printed := if time > 1.9 then 1 else 0;
        height := if time > 2.9 then {last} else {{{{4, 3, 0, 4.5}}}};
      end when;
    end M;"""
    run, seen = simulate_text(text, 5.0), []
    for time in (0.7, 1.2, 2.2, 3.2, 4.2):
        pattern = run.at("controller.pattern", time, (1, 4))[0].tolist()
        seen.append((int(run.at("controller.layer_command", time)), pattern))
    first, empty = (1, [1.0, 2.0, 0.0, 0.0]), [0.0] * 4
    assert seen == [(0, empty), first, first, first, (1, empty)]
    assert run.at("controller.status", 4.2) == 3  # done


def test_scan_is_of_the_layer_that_was_the_newest_when_it_began() -> None:
    """A layer is printed every second, and a scan takes 1.6 s."""
    text, _ = printed(lu(INKS))
    sensor = f"""
      InkLoop.Sensors.ProfileSensor sensor(nx={NX}, ny={NY}, scan_duration=1.6);
    equation
      connect(deposition.height, sensor.height);
      connect(deposition.layers_printed, sensor.layers_printed);"""
    run = simulate_text(text.replace("equation", sensor), LAYERS + 3.0)
    for second, scanned in ((1.7, 0), (3.3, 1), (4.9, 3), (6.5, 4)):
        assert run.at("sensor.layers_scanned", second) == scanned
        surface = START if scanned == 0 else run.at("deposition.height", scanned + 0.5, SHAPE)
        assert run.at("sensor.measured_height", second, SHAPE) == pytest.approx(surface, rel=1e-12, abs=0.0)


@pytest.mark.parametrize("count", [(0, 0, 0), (77, 4, 2_000_000_000), (2_147_483_647, 7, 123_456_789)])
def test_random_numbers_are_philox_bit_for_bit(count) -> None:
    """The last bit of a word decides nothing smaller than 2^-53, so equal numbers of 53 bits are equal bits."""
    seed, stream, cell = count
    text = f"""model M
      discrete Real word[4](each start=-1, each fixed=true);
      discrete Real u(start=-1, fixed=true);
      discrete Real z(start=-1, fixed=true);
    algorithm
      when sample(0.25, 1) then
        word := InkLoop.Functions.Random.philox({{{seed}, {stream}}}, {{{cell}, 0, 9, 0}});
        u := InkLoop.Functions.Random.uniform({seed}, {stream}, {cell}, 9);
        z := InkLoop.Functions.Random.normal({seed}, {stream}, {cell}, 9);
      end when;
    end M;"""
    run = simulate_text(text, 0.9)
    assert tuple(run.at(f"word[{k}]", 0.5) for k in (1, 2, 3, 4)) == philox((seed, stream), (cell, 0, 9, 0))
    assert run.at("u", 0.5) == uniforms(seed, stream, cell, 9)[0]
    assert run.at("z", 0.5) == pytest.approx(normal(seed, stream, cell, 9), rel=1e-14, abs=0.0)


@pytest.mark.parametrize(
    ("command", "material", "duration", "message"),
    [
        ("2", 1, 0.0, "layer_command is out of order"),
        ("1", -1, 0.0, "pattern has a value that is no material"),
        ("1", 3, 0.0, "pattern has a value that is no material"),
        ("pre(layer) + 1", 1, 7.0, "layer_command is out of order"),
    ],
    ids=["a layer is left out", "below 0", "no material", "busy"],
)
def test_what_the_contract_refuses_stops_the_simulation_with_a_message(command, material, duration, message) -> None:
    text = f"""model M
          InkLoop.Deposition.LayerDeposition deposition(nx=2, ny=2, layer_duration={duration});
          Integer layer(start=0, fixed=true);
        equation
          deposition.layer_command = layer;
          deposition.pattern = fill({material}, 2, 2);
        algorithm
          when sample(1, 5) then
            layer := {command};
          end when;
        end M;"""
    with pytest.raises(rumoca.SimulationError, match=message):
        simulate_text(text, 7.0)
