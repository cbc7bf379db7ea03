"""The bill of materials of a release, in CycloneDX 1.6: its files, what it requires, and what compiled it.

Versions are those of this environment, which the tests passed with; extras are left out.
"""

from __future__ import annotations

import hashlib
import tomllib
import uuid
from datetime import UTC, datetime
from importlib.metadata import Distribution
from pathlib import Path

from cyclonedx.contrib.license.factories import LicenseFactory
from cyclonedx.model import ExternalReference, ExternalReferenceType, HashAlgorithm, HashType, XsUri
from cyclonedx.model.bom import Bom, BomMetaData
from cyclonedx.model.component import Component, ComponentScope, ComponentType
from cyclonedx.output.json import JsonV1Dot6
from packageurl import PackageURL
from packaging.utils import canonicalize_name
from tools.release.requirements import closure

from inkloop.files import write_text

COMPILER = "ziglang"
"""Start-up code and C library parts of it are in the binaries: compiler-rt, for Windows mingw-w64."""


def write_sbom(root: Path, folder: Path, epoch: int) -> Path:
    """Write inkloop-VERSION.cdx.json about the files in `folder`. Raises InkloopError."""
    file = tomllib.loads((root / "pyproject.toml").read_text("utf-8"))
    project = file["project"]
    required, needs = closure(project["dependencies"])
    builders, _ = closure([*file["build-system"]["requires"], COMPILER], transitive=False)
    itself = Component(
        name=project["name"],
        version=project["version"],
        type=ComponentType.APPLICATION,
        bom_ref=project["name"],
        licenses=[LicenseFactory().make_from_string(project["license"])],
        purl=PackageURL("pypi", name=project["name"], version=project["version"]),
        external_references=[reference(path) for path in sorted(folder.iterdir())],
    )
    components = {name: component(each, ComponentScope.REQUIRED) for name, each in required.items()}
    for name, each in builders.items():
        if name not in components:  # FMPy is both
            components[name] = component(each, ComponentScope.EXCLUDED)
    digest = "".join(str(each.hashes[0].content) for each in itself.external_references)
    bom = Bom(
        serial_number=uuid.uuid5(uuid.NAMESPACE_OID, digest),
        metadata=BomMetaData(component=itself, timestamp=datetime.fromtimestamp(epoch, UTC)),
        components=components.values(),
    )
    bom.register_dependency(itself, [components[name] for name in sorted(needs[""])])
    for name in required:
        bom.register_dependency(components[name], [components[other] for other in sorted(needs[name])])
    path = folder / f"{project['name']}-{project['version']}.cdx.json"
    write_text(path, JsonV1Dot6(bom).output_as_string(indent=1) + "\n")
    return path


def component(found: Distribution, scope: ComponentScope) -> Component:
    """A package with its licence, as it states it itself."""
    metadata = found.metadata
    name, version = canonicalize_name(metadata["Name"]), metadata["Version"]
    kinds = [each.rpartition(" :: ")[2] for each in metadata.get_all("Classifier") or [] if each.startswith("License")]
    text = "".join(metadata.get_all("License") or [])
    short = text if "\n" not in text and len(text) < 80 else ""  # some write the whole licence there
    stated = "".join(metadata.get_all("License-Expression") or []) or short or " OR ".join(kinds)
    return Component(
        name=name,
        version=version,
        bom_ref=f"{name}=={version}",
        scope=scope,
        licenses=[LicenseFactory().make_from_string(stated)] if stated else [],
        purl=PackageURL("pypi", name=name, version=version),
    )


def reference(path: Path) -> ExternalReference:
    """A file of the release with its sum."""
    return ExternalReference(
        type=ExternalReferenceType.DISTRIBUTION,
        url=XsUri(path.name),
        hashes=[HashType(alg=HashAlgorithm.SHA_256, content=hashlib.sha256(path.read_bytes()).hexdigest())],
    )
