"""Numbers of the messages of a node as parameters of ODX (ISO 22901-1)."""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum, IntFlag
from html import escape

from odxtools.compumethods.compucategory import CompuCategory
from odxtools.compumethods.compuconst import CompuConst
from odxtools.compumethods.compuinternaltophys import CompuInternalToPhys
from odxtools.compumethods.compumethod import CompuMethod
from odxtools.compumethods.compurationalcoeffs import CompuRationalCoeffs
from odxtools.compumethods.compuscale import CompuScale
from odxtools.compumethods.identicalcompumethod import IdenticalCompuMethod
from odxtools.compumethods.limit import Limit
from odxtools.compumethods.linearcompumethod import LinearCompuMethod
from odxtools.compumethods.texttablecompumethod import TexttableCompuMethod
from odxtools.dataobjectproperty import DataObjectProperty
from odxtools.description import Description
from odxtools.diagcodedtype import DiagCodedType
from odxtools.diagdatadictionaryspec import DiagDataDictionarySpec
from odxtools.endofpdufield import EndOfPduField
from odxtools.minmaxlengthtype import MinMaxLengthType
from odxtools.nameditemlist import NamedItemList
from odxtools.odxlink import DocType, OdxDocFragment, OdxLinkId, OdxLinkRef
from odxtools.odxtypes import DataType
from odxtools.parameters.codedconstparameter import CodedConstParameter
from odxtools.parameters.matchingrequestparameter import MatchingRequestParameter
from odxtools.parameters.parameter import Parameter
from odxtools.parameters.valueparameter import ValueParameter
from odxtools.physicaltype import PhysicalType
from odxtools.standardlengthtype import StandardLengthType
from odxtools.structure import Structure
from odxtools.termination import Termination
from odxtools.unit import Unit
from odxtools.unitspec import UnitSpec

from inkloop.units import MS_PER_S
from inkloop_hardware.protocol import layout
from inkloop_hardware.protocol.layout import Part

WHOLE, REAL, TEXT, BYTES = DataType.A_UINT32, DataType.A_FLOAT64, DataType.A_ASCIISTRING, DataType.A_BYTEFIELD
CONTAINER = OdxDocFragment("inkloop", DocType.CONTAINER)
NODE = "Node"
"""The layer of what all nodes have, whose dictionary the other layers use."""


def made_id(layer: str, name: str) -> OdxLinkId:
    """The id of a thing of a layer."""
    return OdxLinkId(f"{layer}.{name}", (CONTAINER, OdxDocFragment(layer, DocType.LAYER)))


def const(name: str, at: int, value: int, size: int = 1) -> Parameter:
    """Bytes that are always the same."""
    coded = StandardLengthType(base_data_type=WHOLE, bit_length=8 * size)
    return CodedConstParameter(short_name=name, byte_position=at, coded_value_raw=str(value), diag_coded_type=coded)


def echo(part: Part, at: int, of: int) -> Parameter:
    """Bytes of a response that repeat those of the request from `of` on."""
    return MatchingRequestParameter(
        short_name=_name(part), byte_position=at, request_byte_position=of, byte_length=part.size
    )


def echoes(parts: Iterable[Part], at: int, of: int) -> list[Parameter]:
    """`echo` of each of several numbers in a row."""
    found = []
    for part in parts:
        found.append(echo(part, at, of))
        at, of = at + part.size, of + part.size
    return found


class Dictionary:
    """Kinds of values that parameters refer to, each made once."""

    def __init__(self) -> None:
        self._properties: dict[str, DataObjectProperty] = {}
        self._structures: list[Structure] = []
        self._fields: list[EndOfPduField] = []
        self._second = Unit(odx_id=made_id(NODE, "second"), short_name="second", display_name="s")

    def spec(self) -> DiagDataDictionarySpec:
        """All of them."""
        return DiagDataDictionarySpec(
            data_object_props=NamedItemList(self._properties.values()),
            structures=NamedItemList(self._structures),
            end_of_pdu_fields=NamedItemList(self._fields),
            unit_spec=UnitSpec(units=NamedItemList([self._second])),
        )

    def values(self, parts: Iterable[Part], at: int) -> list[Parameter]:
        """A parameter for each number from byte `at` on; of flags, one for each bit: 0 or 1."""
        found: list[Parameter] = []
        for part in parts:
            if issubclass(part.type, IntFlag):
                found += self._bits(part, at)
            else:
                found.append(self._value(_name(part), at, self._kind(part)))
            at += part.size
        return found

    def rest(self, name: str, at: int, type_: DataType = BYTES) -> Parameter:
        """All bytes from `at` on, as bytes or text."""
        coded = MinMaxLengthType(base_data_type=type_, min_length=0, termination=Termination.END_OF_PDU)
        return self._value(name, at, self._property(type_.name.title(), coded, _plain(type_), type_))

    def records(self, name: str, at: int, record: type) -> Parameter:
        """As many records as come from byte `at` on."""
        title = record.__name__
        structure = Structure(
            odx_id=made_id(NODE, title),
            short_name=title,
            byte_size=layout.size(record),
            parameters=NamedItemList(self.values(layout.parts(record), 0)),
        )
        many = EndOfPduField(
            odx_id=made_id(NODE, f"{title}s"),
            short_name=f"{title}s",
            structure_ref=OdxLinkRef.from_id(structure.odx_id),
        )
        self._structures.append(structure)
        self._fields.append(many)
        return self._value(name, at, OdxLinkRef.from_id(many.odx_id))

    def words(self, name: str, at: int, title: str, words: Iterable[tuple[int, str, str]]) -> Parameter:
        """A byte of which each value has a word and an explanation."""
        return self._value(name, at, self._property(title, _coded(8), _table(words), TEXT))

    def _bits(self, part: Part, at: int) -> Iterable[Parameter]:
        bit = self._property("Bit", _coded(1), _plain(WHOLE), WHOLE)
        for flag in part.type:
            down, position = divmod(int(flag).bit_length() - 1, 8)
            name = f"{_name(part)}_{flag.name.lower()}"
            yield self._value(name, at + part.size - 1 - down, bit, bit_position=position)

    def _kind(self, part: Part) -> OdxLinkRef:
        bits = 8 * part.size
        if part.type is float:
            return self._property(f"Time{bits}", _coded(bits), _linear(1 / MS_PER_S), REAL, self._second)
        if issubclass(part.type, IntEnum):
            words = [(int(one), one.name, "") for one in part.type]
            return self._property(f"{part.type.__name__}{bits}", _coded(bits), _table(words), TEXT)
        return self._property(f"Number{bits}", _coded(bits), _plain(WHOLE), WHOLE)

    def _property(
        self, title: str, coded: DiagCodedType, method: CompuMethod, type_: DataType, unit: Unit | None = None
    ) -> OdxLinkRef:
        made = DataObjectProperty(
            odx_id=made_id(NODE, title),
            short_name=title,
            compu_method=method,
            diag_coded_type=coded,
            physical_type=PhysicalType(base_data_type=type_),
            unit_ref=OdxLinkRef.from_id(unit.odx_id) if unit else None,
        )
        return OdxLinkRef.from_id(self._properties.setdefault(title, made).odx_id)

    def _value(self, name: str, at: int, kind: OdxLinkRef, *, bit_position: int | None = None) -> Parameter:
        return ValueParameter(short_name=name, byte_position=at, bit_position=bit_position, dop_ref=kind)


def _name(part: Part) -> str:
    return part.name.rstrip("_")


def _coded(bits: int) -> DiagCodedType:
    return StandardLengthType(base_data_type=WHOLE, bit_length=bits)


def _plain(type_: DataType) -> CompuMethod:
    return IdenticalCompuMethod(category=CompuCategory.IDENTICAL, physical_type=type_, internal_type=type_)


def _linear(factor: float) -> CompuMethod:
    coefficients = CompuRationalCoeffs(value_type=REAL, numerators=[0.0, factor], denominators=[1.0])
    scale = CompuScale(compu_rational_coeffs=coefficients, domain_type=WHOLE, range_type=REAL)
    return LinearCompuMethod(
        category=CompuCategory.LINEAR,
        compu_internal_to_phys=CompuInternalToPhys(compu_scales=[scale]),
        physical_type=REAL,
        internal_type=WHOLE,
    )


def _table(words: Iterable[tuple[int, str, str]]) -> CompuMethod:
    return TexttableCompuMethod(
        category=CompuCategory.TEXTTABLE,
        compu_internal_to_phys=CompuInternalToPhys(compu_scales=[_scale(*one) for one in words]),
        physical_type=TEXT,
        internal_type=WHOLE,
    )


def _scale(number: int, word: str, why: str) -> CompuScale:
    limit = Limit(value_raw=str(number), value_type=WHOLE)
    return CompuScale(
        description=Description(text=f"<p>{escape(why)}</p>") if why else None,
        lower_limit=limit,
        upper_limit=limit,
        compu_const=CompuConst(vt=word, data_type=TEXT),
        domain_type=WHOLE,
        range_type=TEXT,
    )
