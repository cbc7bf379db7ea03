"""The UnitDefinitions of an FMU determine how its values are converted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from inkloop.component import Component, Job, Port
from inkloop.components import catalog
from inkloop.components.port_tables import mapped_ports
from inkloop.fmu import FmuComponent, FmuDescription, describe
from inkloop.master.wiring import Connection, Transfer, check
from inkloop.testing import job
from inkloop.units import conversion
from support.fmus.amplifier import altered, build
from support.toys import FunctionComponent

pytestmark = pytest.mark.compiled
BOTH = pytest.mark.parametrize("fmi", [2, 3])
UNITS = """<UnitDefinitions>
<Unit name="inch"><BaseUnit m="1" factor="0.0254"/></Unit>
<Unit name="micrometer"><BaseUnit m="1" factor="1e-6"/></Unit>
<Unit name="um"><BaseUnit m="1" factor="1e-3"/></Unit>
<Unit name="mm"><BaseUnit m="1" factor="1e-3"/></Unit>
<Unit name="Pa"><BaseUnit kg="1" m="-1" s="-2"/></Unit>
<Unit name="hPa"><BaseUnit kg="1" m="-1" s="-2" factor="100"/></Unit>
<Unit name="degC"><BaseUnit K="1" offset="273.15"/></Unit>
<Unit name="K"><BaseUnit K="1"/></Unit>
<Unit name="step"/>
</UnitDefinitions><TypeDefinitions>"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("amplifier")


def with_units(folder: Path, fmi: int, unit: str) -> Path:
    """The amplifier with `x` and `y` in a unit that it defines."""
    changes = (("<TypeDefinitions>", UNITS), ('unit="m"', f'unit="{unit}"'))
    return altered(build(folder, fmi), folder / f"{unit}{fmi}.fmu", *changes)


def renamed_to_contract(folder: Path, fmi: int, unit: str) -> Path:
    """The amplifier with its x called measured_height and its y called height."""
    names = ('name="x', 'name="measured_height'), ('name="y', 'name="height')
    return altered(with_units(folder, fmi, unit), folder / f"contract-{unit}{fmi}.fmu", *names)


def small_job() -> Job:
    return Job(1, 3, 1e-4, np.zeros((1, 3)), np.ones((1, 3), np.bool_))


def unit_of_x(folder: Path, fmi: int, unit: str) -> str:
    description: FmuDescription = describe(with_units(folder, fmi, unit))
    return description.variables["x"].unit


@BOTH
@pytest.mark.parametrize(
    ("unit", "metres"), [("inch", 0.0254), ("micrometer", 1e-6), ("um", 1e-3), ("mm", 1e-3)]
)  # its um is a mm
def test_definition_of_the_fmu_decides(folder: Path, fmi: int, unit: str, metres: float) -> None:
    found = unit_of_x(folder, fmi, unit)
    assert found == unit
    assert conversion(found, "m") == metres
    assert conversion("m", found) == 1.0 / metres
    assert conversion(found, "s") is None


@BOTH
def test_wiring_converts_by_the_definition(folder: Path, fmi: int) -> None:
    part = FmuComponent(with_units(folder, fmi, "inch"))
    source = Port("x", "m", (3,))
    target = next(port for port in part.inputs if port.name == "x")
    components: dict[str, Component] = {"source": FunctionComponent(outputs=(source,)), "part": part}
    assert check(components, [Connection("source.x", "part.x")]) == []
    arrived = Transfer.of(Connection("source.x", "part.x"), source, target)(np.array([0.0254, 0.0508, 0.0]))
    np.testing.assert_allclose(arrived, [1.0, 2.0, 0.0], rtol=1e-15)
    part.terminate()


def test_mapped_port_takes_the_definition_and_no_other_unit(folder: Path) -> None:
    part = FmuComponent(with_units(folder, 3, "inch"), structural={"n": 35})
    (mapped,), _, errors = mapped_ports(part.inputs[1:], [], job(), {"thickness": {"variable": "x"}})
    assert not errors
    assert mapped.port.unit == "m"
    assert mapped.factor == 1.0 / 0.0254
    *_, (error,) = mapped_ports(part.inputs[1:], [], job(), {"thickness": {"variable": "x", "unit": "um"}})
    assert error == "ports.thickness.unit is 'um', but the FMU declares x in [inch]; leave it out"
    part.terminate()


@BOTH
@pytest.mark.parametrize(("unit", "metres"), [("inch", 0.0254), ("mm", 1e-3)])
def test_height_of_the_layer_contract_goes_by_the_unit_of_the_fmu(folder: Path, fmi: int, unit: str, metres: float):
    """Without a word in the scenario: recorder, sensor and controller take metres."""
    fmu = renamed_to_contract(folder, fmi, unit)
    part = catalog.make("Fmu", small_job(), {"file": str(fmu)})
    assert {port.name: port.unit for port in (*part.inputs, *part.outputs)}["height"] == "m"
    part.initialize(0, {"measured_height": np.array([[1.0, 2.0, 3.0]])})
    values = part.do_step(0, 10**9, {"measured_height": np.array([[1.0, 2.0, 3.0]])})
    np.testing.assert_allclose(values["height"], [[2.0, 4.0, 6.0]], rtol=1e-15)  # the gain of the amplifier alone
    part.terminate()


def test_height_of_another_dimension_is_an_error(folder: Path) -> None:
    part = catalog.make("Fmu", small_job(), {"file": str(renamed_to_contract(folder, 3, "Pa"))})
    sensor = FunctionComponent(inputs=[Port("height", "m", (3,))])
    error, *_ = check({"part": part, "sensor": sensor}, [Connection("part.height", "sensor.height")])
    assert error.startswith("part.height gives [Pa], sensor.height takes [m]: same quantity needed")
    part.terminate()
    checked = catalog.check("Fmu", small_job(), {"file": str(with_units(folder, 3, "Pa")), "ports": {"height": "y"}})
    assert checked.errors == [
        "ports.height.variable is 'y' in [Pa]; needs a unit of the quantity [m]: write unit, one of um, mm, nm, m, "
        "and a gain if it takes one"
    ]


def test_start_of_a_mapped_port_is_in_its_unit(folder: Path) -> None:
    fmu = altered(with_units(folder, 3, "inch"), folder / "started.fmu", ('start="0"', 'start="1 2 3"'))
    part = catalog.make("Fmu", small_job(), {"file": str(fmu), "ports": {"thickness": "x"}})
    port = next(port for port in part.inputs if port.name == "thickness")
    np.testing.assert_allclose(port.start_value(), [0.0254, 0.0508, 0.0762], rtol=1e-15)
    part.terminate()


@pytest.mark.parametrize(
    ("source", "target", "factor"),
    [("hPa", "Pa", 100.0), ("hPa", "", None), ("degC", "K", None), ("degC", "degC", 1.0), ("step", "step", 1.0)],
)
def test_other_quantities_are_converted_by_their_definition(
    folder: Path, source: str, target: str, factor: float | None
) -> None:
    found, other = unit_of_x(folder, 3, source), unit_of_x(folder, 3, target) if target else "m"
    assert conversion(found, other) == factor
