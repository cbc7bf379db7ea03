"""Kinds that are FMUs: our own models by name, and any FMU file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from inkloop.component import Component, Job, Port, Ports
from inkloop.components.fmu_parameters import FORMS, JOB_PARAMETERS, Parsed, parse_file, parse_model
from inkloop.components.kind import Bench, Checked
from inkloop.components.port_mapping import MappedPort, MappedPorts, ports_of
from inkloop.components.port_tables import OPTION, mapped_ports
from inkloop.errors import FmuError
from inkloop.files import temporary_folder
from inkloop.fmu import FmuComponent, FmuDescription, archive_error, describe, platform_error
from inkloop.fmu.reading import fmu_file
from inkloop.fmu_writer.export import INTERVALS, export_fmu, find_fmu


@dataclass(frozen=True)
class FmuModel:
    """One of our FMUs."""

    model: str
    path_option: ClassVar[str | None] = None

    def check(self, job: Job, options: Mapping[str, object]) -> Checked:
        """Check parameters against the description of the FMU. Raises FmuError if it is not there."""
        parsed = parse_model(self.model, job, options)
        if parsed.errors:
            return Checked(self.model, parsed.errors)
        form = str(options.get("fmi", FORMS[0]))
        file = parsed.description.path if form == FORMS[0] else find_fmu(self.model, form)

        def construct(bench: Bench, name: str) -> Component:
            return _make_model(self.model, form, file, parsed, name)

        if errors := _binary_errors(file, f"kind is {self.model!r}, whose FMU"):
            return Checked(self.model, errors)
        return Checked(self.model, (), _ports(parsed, describe(file)), construct)


class FmuFile:
    """Any FMU file, named by the option `file`."""

    path_option: ClassVar[str | None] = "file"

    def check(self, job: Job, options: Mapping[str, object]) -> Checked:
        """Check parameters and mapped ports against the description. Raises FmuError if the file cannot be read."""
        if not isinstance(options.get("file"), str):
            return Checked("Fmu", ["file is missing; name the .fmu file"])
        file = Path(str(options["file"]))
        try:
            with fmu_file(file) as path:
                parsed = parse_file(describe(path), job, options)
                errors = _binary_errors(path, f"file is {options['file']!r}, which")
        except FmuError as error:
            advice = "" if file.exists() else "; give its path from the scenario's folder"
            return Checked("Fmu", [f"file: {error}{advice}"])
        if not isinstance(asked := options.get(JOB_PARAMETERS, True), bool):
            errors.append(f"{JOB_PARAMETERS} is {asked!r}; expected true or false")
        inputs: list[MappedPort] = []
        outputs: list[MappedPort] = []
        ports = Ports((), ()) if parsed.errors else _ports(parsed, parsed.description)
        if not parsed.errors:
            inputs, outputs, wrong = mapped_ports(ports.inputs, ports.outputs, job, options.get(OPTION, {}))
            errors += wrong
            ports = Ports(ports_of(inputs, ports.inputs), ports_of(outputs, ports.outputs))
        errors += exchange_errors(parsed.description)
        if errors := [*errors, *parsed.errors]:
            return Checked("Fmu", errors)

        def construct(bench: Bench, name: str) -> Component:
            with fmu_file(file) as path:  # a component keeps what it needs of the file
                fmu = FmuComponent(path, name=name, parameters=parsed.parameters, structural=parsed.structural)
            return MappedPorts(fmu, inputs, outputs) if inputs or outputs else fmu

        described = parsed.description
        single = file.resolve() if described.is_single else None
        buses = [bus.name for bus in described.buses]
        is_simulation = described.is_bus_simulation
        return Checked("Fmu", (), ports, construct, single, buses, is_simulation, _exchange_notes(described))


def _make_model(model: str, form: str, file: Path, parsed: Parsed, name: str) -> FmuComponent:
    """One of our FMUs; where its sizes are fixed, one exported for the job."""
    sizes = parsed.structural
    if form == FORMS[0]:
        return FmuComponent(file, name=name, parameters=parsed.parameters, structural=sizes)
    with temporary_folder("export") as folder:  # a component keeps what it needs of the file
        made = export_fmu(
            model,
            fmi="2" if form == "fmi2" else "3",
            nx=sizes["nx"],
            ny=sizes["ny"],
            intervals=sizes.get(INTERVALS),
            fixed=True,
            force=True,
            out=Path(folder) / f"{model}.fmu",
        )
        return FmuComponent(made, name=name, parameters=parsed.parameters)


def _ports(parsed: Parsed, file: FmuDescription) -> Ports:
    """The ports of an FMU for its sizes, in the order of its own file: the order differs between the forms of our
    FMUs.
    """

    def ordered(causality: str) -> tuple[Port, ...]:
        ports = {port.name: port for port in parsed.description.ports(causality, parsed.sizes)}
        return tuple(ports[name] for name in file.variables if name in ports)

    return Ports(ordered("input"), ordered("output"))


def exchange_errors(description: FmuDescription) -> list[str]:
    """Reasons why the master cannot run an FMU: buses that it cannot serve; inputs and outputs, none of them
    exchanged.
    """
    unserved = [
        f"file is {description.path.name!r}, whose bus {name} this master cannot serve: {reason}"
        for name, reason in description.unserved.items()
    ]
    has_values = any(each.causality in ("input", "output") for each in description.variables.values())
    if unserved or description.buses or has_values or not description.unused:
        return unserved
    kinds = ", ".join(sorted({kind.split()[0] for kind in description.unused.values()}))
    return [
        f"file is {description.path.name!r}, whose inputs and outputs are of type {kinds}; this master exchanges "
        "numbers, truth values and what goes over a CAN bus (FMI-LS-BUS): run it in a tool that exchanges the others"
    ]


def _exchange_notes(description: FmuDescription) -> list[str]:
    """A warning of inputs and outputs that the master leaves out, where it takes others."""
    if not description.unused:
        return []
    first, *others = description.unused
    more = f" and {len(others)} more" if others else ""
    return [
        f"{first} ({description.unused[first]}){more} of {description.path.name} are not exchanged: clocks and "
        "binaries are those of a bus, texts parameters; `inkloop info` lists them"
    ]


def _binary_errors(path: Path, what: str) -> list[str]:
    """Reasons why this machine cannot run an FMU."""
    errors = (platform_error(describe(path)), archive_error(path))
    return [f"{what} {error}" for error in errors if error]
