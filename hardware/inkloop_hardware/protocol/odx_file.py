"""The services of all nodes as a PDX file (ODX, ISO 22901-1), for testers of others.

The layer `Node` has what all nodes have, `Head`, `Stage`, `Cure` and `Profiler` what one has besides, with its
arbitration ids.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from odxtools.comparam import Comparam
from odxtools.comparaminstance import ComparamInstance
from odxtools.comparamspec import ComparamSpec
from odxtools.comparamsubset import ComparamSubset
from odxtools.complexcomparam import ComplexComparam
from odxtools.compumethods.compucategory import CompuCategory
from odxtools.compumethods.identicalcompumethod import IdenticalCompuMethod
from odxtools.database import Database
from odxtools.dataobjectproperty import DataObjectProperty
from odxtools.diaglayercontainer import DiagLayerContainer
from odxtools.diaglayers.basevariant import BaseVariant
from odxtools.diaglayers.basevariantraw import BaseVariantRaw
from odxtools.diaglayers.diaglayertype import DiagLayerType
from odxtools.diaglayers.ecuvariant import EcuVariant
from odxtools.diaglayers.ecuvariantraw import EcuVariantRaw
from odxtools.diaglayers.protocol import Protocol
from odxtools.diaglayers.protocolraw import ProtocolRaw
from odxtools.nameditemlist import NamedItemList
from odxtools.odxlink import DocType, OdxDocFragment, OdxLinkId, OdxLinkRef
from odxtools.parentref import ParentRef
from odxtools.physicaltype import PhysicalType
from odxtools.protstack import ProtStack
from odxtools.standardizationlevel import StandardizationLevel
from odxtools.standardlengthtype import StandardLengthType
from odxtools.usage import Usage
from odxtools.writepdxfile import write_pdx_file

from inkloop.files import replaced
from inkloop_hardware.protocol.codec import Codec
from inkloop_hardware.protocol.odx_services import Services, refusal
from inkloop_hardware.protocol.odx_values import CONTAINER, NODE, WHOLE, Dictionary, made_id
from inkloop_hardware.protocol.records import Node

PROTOCOL = "UdsOnCan"
STACK, LINK = "ISO_15765_3_on_ISO_15765_2", "ISO_11898_2_DWCAN"
"""Names of ISO 22900-2: UDS over ISO-TP; CAN on two wires."""
TABLE, REQUEST_ID, ANSWER_ID, BIT_RATE = "CP_UniqueRespIdTable", "CP_CanPhysReqId", "CP_CanRespUSDTId", "CP_Baudrate"
SUBSET, SPEC = (
    OdxDocFragment("inkloop_can", DocType.COMPARAM_SUBSET),
    OdxDocFragment("inkloop_uds", DocType.COMPARAM_SPEC),
)


def write_services(path: Path) -> None:
    """Write the PDX file, whole or not at all."""
    made = database()
    with replaced(path) as new:
        write_pdx_file(str(new), made)


def database() -> Database:
    """The services, as odxtools holds them."""
    codec, dictionary = Codec(), Dictionary()
    protocol = _protocol(codec)
    ecus = [_ecu(node, codec, dictionary) for node in Node]
    made = Database()
    made.short_name = CONTAINER.doc_name
    made.comparam_subsets.append(_subset())
    made.comparam_specs.append(_spec())
    made.diag_layer_containers.append(
        DiagLayerContainer(
            odx_id=OdxLinkId(CONTAINER.doc_name, (CONTAINER,)),
            short_name=CONTAINER.doc_name,
            protocols=NamedItemList([protocol]),
            base_variants=NamedItemList([_all(dictionary)]),
            ecu_variants=NamedItemList(ecus),
        )
    )
    made.refresh()
    return made


def _all(dictionary: Dictionary) -> BaseVariant:
    """The layer of what all nodes have; last, for its dictionary is that of all layers."""
    services = Services(NODE, dictionary)
    services.of_all()
    raw = BaseVariantRaw(
        **_named(NODE, DiagLayerType.BASE_VARIANT),
        **services.fields(),
        global_negative_responses=NamedItemList([refusal(NODE, dictionary)]),
        diag_data_dictionary_spec=dictionary.spec(),
        parent_refs=[_parent(PROTOCOL)],
    )
    return BaseVariant(diag_layer_raw=raw)


def _ecu(node: Node, codec: Codec, dictionary: Dictionary) -> EcuVariant:
    services = Services(node, dictionary)
    services.of(node)
    ids: list[Any] = [str(codec.request_id(node)), str(codec.answer_id(node))]
    raw = EcuVariantRaw(
        **_named(node, DiagLayerType.ECU_VARIANT),
        **services.fields(),
        comparam_refs=[ComparamInstance(value=ids, spec_ref=_reference(TABLE))],
        parent_refs=[_parent(NODE)],
    )
    return EcuVariant(diag_layer_raw=raw)


def _protocol(codec: Codec) -> Protocol:
    attributes = codec.database.dbc.attributes if codec.database.dbc else {}
    rate = ComparamInstance(value=str(attributes["Baudrate"].value), spec_ref=_reference(BIT_RATE))
    raw = ProtocolRaw(
        **_named(PROTOCOL, DiagLayerType.PROTOCOL),
        comparam_spec_ref=OdxLinkRef(SPEC.doc_name, (SPEC,)),
        comparam_refs=[rate],
        prot_stack_snref=STACK,
    )
    return Protocol(diag_layer_raw=raw)


def _named(name: str, type_: DiagLayerType) -> dict[str, Any]:
    return {"odx_id": made_id(name, "layer"), "short_name": str(name), "variant_type": type_}


def _parent(layer: str) -> ParentRef:
    return ParentRef(layer_ref=OdxLinkRef.from_id(made_id(layer, "layer")))


def _reference(name: str) -> OdxLinkRef:
    return OdxLinkRef(name, (SUBSET,))


def _spec() -> ComparamSpec:
    stack = ProtStack(
        odx_id=OdxLinkId(STACK, (SPEC,)),
        short_name=STACK,
        pdu_protocol_type=STACK,
        physical_link_type=LINK,
        comparam_subset_refs=[_reference(SUBSET.doc_name)],
    )
    return ComparamSpec(
        odx_id=OdxLinkId(SPEC.doc_name, (SPEC,)), short_name=SPEC.doc_name, prot_stacks=NamedItemList([stack])
    )


def _subset() -> ComparamSubset:
    """The communication parameters that differ from node to node or from bus to bus."""
    number = DataObjectProperty(
        odx_id=OdxLinkId("number", (SUBSET,)),
        short_name="number",
        compu_method=IdenticalCompuMethod(category=CompuCategory.IDENTICAL, physical_type=WHOLE, internal_type=WHOLE),
        diag_coded_type=StandardLengthType(base_data_type=WHOLE, bit_length=32),
        physical_type=PhysicalType(base_data_type=WHOLE),
    )
    table = ComplexComparam(
        **_standard(TABLE, "UNIQUE_ID"), subparams=NamedItemList([_plain(REQUEST_ID), _plain(ANSWER_ID)])
    )
    return ComparamSubset(
        odx_id=OdxLinkId(SUBSET.doc_name, (SUBSET,)),
        short_name=SUBSET.doc_name,
        category="TRANSPORT",
        comparams=NamedItemList([_plain(BIT_RATE)]),
        complex_comparams=NamedItemList([table]),
        data_object_props=NamedItemList([number]),
    )


def _plain(name: str) -> Comparam:
    return Comparam(**_standard(name, "COM"), physical_default_value_raw="0", dop_ref=_reference("number"))


def _standard(name: str, of: str) -> dict[str, Any]:
    return {
        "odx_id": OdxLinkId(name, (SUBSET,)),
        "short_name": name,
        "param_class": of,
        "cptype": StandardizationLevel.STANDARD,
        "cpusage": Usage.ECU_COMM,
    }
