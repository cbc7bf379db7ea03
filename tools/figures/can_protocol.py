"""Tables of can-protocol.md, written from the DBC."""

from __future__ import annotations

import re
from collections.abc import Iterable
from itertools import takewhile

from cantools.database.can import Message, Signal
from tools.figures.pages import DOCS, Texts

from inkloop.units import MS_PER_S
from inkloop_hardware.protocol.codec import Codec

SUPERVISION = ("Crc8", "Counter")
"""The signals of E2E profile 1, alike in all supervised frames."""
SIGNAL_HEADS = ("| signal | bits | value | meaning |", "|---|---|---|---|")


def run() -> None:
    """Nothing: the tables come from the DBC."""


def texts() -> Texts:
    """The tables of all frames, signals and values."""
    return {DOCS / "reference" / "can-protocol.md": {"from inkloop.dbc": f"\n\n{tables(Codec())}\n"}}


def tables(codec: Codec) -> str:
    """One table of all frames, one of signals per layout, one per value table."""
    messages = sorted(codec.database.messages, key=lambda message: message.frame_id)
    lines = ["| id | message | from | bytes | cycle | supervised | what it is |", "|---|---|---|---|---|---|---|"]
    lines += [_frame_row(codec, alike) for alike in _alike(messages)]
    layouts: dict[tuple[str, ...], list[Message]] = {}
    for message in messages:
        layouts.setdefault(tuple(_layout(signal) for signal in message.signals), []).append(message)
    supervised = [message for message in messages if codec.data_id(message.name)]
    lines += ["", "### All supervised frames", "", *SIGNAL_HEADS]
    lines += [_signal_row(supervised[0].get_signal_by_name(name), supervised) for name in SUPERVISION]
    for alike in layouts.values():
        lines += ["", f"### {', '.join(message.name for message in alike)}", "", *SIGNAL_HEADS]
        lines += [_signal_row(signal, alike) for signal in alike[0].signals if signal.name not in SUPERVISION]
    dbc = codec.database.dbc
    for table, words in (dbc.value_tables if dbc else {}).items():
        listed = ", ".join(f"{number} `{word}`" for number, word in sorted(words.items()))
        lines += ["", f"**{table}**: {listed}."]
    return "\n".join(lines) + "\n"


def _layout(signal: Signal) -> str:
    return f"{signal.name} {signal.start} {signal.length} {signal.scale} {signal.unit}"


def _cycle(message: Message) -> str:
    if not message.cycle_time:
        return "on request"
    cycle = f"{message.cycle_time} ms" if message.cycle_time < MS_PER_S else f"{message.cycle_time / MS_PER_S:g} s"
    return cycle if message.send_type == "Cyclic" else f"on event, then {cycle} while active"


def _alike(messages: list[Message]) -> list[list[Message]]:
    """The messages by their signals and direction: those of one group differ by the node."""
    groups: dict[tuple[object, ...], list[Message]] = {}
    for message in messages:
        key = (*map(_layout, message.signals), "Master" in message.senders)
        groups.setdefault(key, []).append(message)
    return list(groups.values())


def _frame_row(codec: Codec, alike: list[Message]) -> str:
    first = alike[0]
    ids = ", ".join(f"0x{message.frame_id:03X}" for message in alike)
    names = ", ".join(f"`{message.name}`" for message in alike)
    senders = ", ".join(dict.fromkeys(sender for message in alike for sender in message.senders))
    supervised = "yes" if codec.data_id(first.name) else ""
    meaning = _shared([re.sub(r"\s+", " ", message.comment or "") for message in alike])
    return f"| {ids} | {names} | {senders} | {first.length} | {_cycle(first)} | {supervised} | {meaning} |"


def _shared(comments: list[str]) -> str:
    """The comment of messages alike: where they differ stands "the node"."""
    begin = _common(comments)
    if begin == comments[0]:
        return begin
    end = _common(comment[len(begin) :][::-1] for comment in comments)[::-1]
    return f"{begin.removesuffix('the ')}the node{end}"


def _common(texts: Iterable[str]) -> str:
    """The begin that the texts share."""
    return "".join(alike[0] for alike in takewhile(lambda alike: len(set(alike)) == 1, zip(*texts, strict=False)))


def _signal_row(signal: Signal, alike: list[Message]) -> str:
    last = signal.start + signal.length - 1
    bits = f"{signal.start}" if last == signal.start else f"{signal.start}-{last}"
    comments = {message.name: message.get_signal_by_name(signal.name).comment or "" for message in alike}
    shared = len(set(comments.values())) == 1
    meaning = comments[alike[0].name] if shared else "; ".join(f"{name}: {text}" for name, text in comments.items())
    signed = ", signed" if signal.is_signed else ""
    return f"| `{signal.name}` | {bits}{signed} | {_value(signal)} | {meaning} |"


def _value(signal: Signal) -> str:
    """Limits, unit and step."""
    if signal.length == 1:
        return "flag"
    if signal.minimum is None:
        return "bytes"
    limits = f"{signal.minimum:.10g} to {signal.maximum:.10g} {signal.unit or ''}".rstrip()
    return limits if signal.scale == 1 else f"{limits}, step {signal.scale:g}"
