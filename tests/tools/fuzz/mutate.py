"""Documents, XML and bytes, changed at random."""

from __future__ import annotations

import copy
import random
from typing import Any
from xml.etree import ElementTree as ET

NUMBERS = (0, 1, -1, 2, 0.5, -0.0, 1e-300, 1e300, -1e300, 1e16, 10**30, 2**31, 2**63, 1e-9, 1e9, float("inf"),
           float("-inf"), float("nan"))  # fmt: skip
TEXTS = ("", " ", "a", "a" * 300, "1", "nan", "1e999", "0x10", "1_0", "../../x", "/", "/etc/passwd", "data:x",
         "no.module:name", "math:pi", "x.py:y", ":", "a:b:c", "pi/2", "9*pi/0", "q1", "tau1", "plant.tau1", "\x00",
         "é\u202e\x1b[31m", "model", "fmu", "control", "didim", "idim_ls", "output_error", "clie", "revolute",
         "prismatic", "average", "torque", "reference", "nominal", "%s%n", "<b>", "'\"", "\ud800")  # fmt: skip
STRUCTURES: tuple[Any, ...] = (None, True, False, [], {}, [[]], {"a": 1}, [1, 2, 3], [None], {"kind": "x"}, {1: 2})
XML_TEXTS = (*(repr(n) for n in NUMBERS if n == n), *(t for t in TEXTS if not set(t) & set("\x00\x1b\ud800")),
             "true", "Real", "Float64", "input", "output", "parameter", "fixed", "4294967296", "9" * 20)  # fmt: skip


def idle(rng: random.Random) -> bool:
    """Whether the input stays as it is, which must be taken: one of fifty."""
    return rng.random() < 0.02


def value(rng: random.Random) -> Any:
    """A value that may fit nowhere."""
    return copy.deepcopy(rng.choice(rng.choice((NUMBERS, NUMBERS, TEXTS, STRUCTURES))))


def _places(node: Any) -> list[tuple[Any, Any]]:
    """Container and key of all values in a document."""
    if isinstance(node, dict):
        return [place for key in node for place in [(node, key), *_places(node[key])]]
    if isinstance(node, list):
        return [place for i in range(len(node)) for place in [(node, i), *_places(node[i])]]
    return []


def _change(rng: random.Random, holder: Any, key: Any, places: list[tuple[Any, Any]]) -> None:
    old = holder[key]
    match rng.randrange(8):
        case 0 if isinstance(holder, dict):
            del holder[key]
        case 1 if isinstance(holder, dict):
            holder[rng.choice((f"{key}x", str(key)[:-1], "name", 1, None, rng.choice(TEXTS)))] = holder.pop(key)
        case 2 if isinstance(holder, list):
            holder[:] = holder[:key] + [copy.deepcopy(old)] * rng.choice((0, 2, 3)) + holder[key + 1 :]
        case 3:
            other, place = rng.choice(places)
            holder[key] = copy.deepcopy(other[place])
        case 4 if isinstance(old, int | float) and not isinstance(old, bool):
            holder[key] = rng.choice((-old, old * 1e3, old * 1e-3, old + 1, 1 / old if old else 0))
        case 5 if isinstance(old, str) and old:
            place = rng.randrange(len(old))
            holder[key] = old[:place] + rng.choice(TEXTS) + old[place + 1 :]
        case 6:
            holder[key] = rng.choice(([old], {"a": old}, [old, old]))
        case _:
            holder[key] = value(rng)


def document(rng: random.Random, content: Any) -> Any:
    """A copy of a document with one to four changes."""
    content = copy.deepcopy(content)
    for _ in range(rng.choice((1, 1, 1, 2, 2, 4))):
        places = [(holder, key) for holder, key in _places(content)]
        if not places:
            break
        holder, key = rng.choice(places)
        _change(rng, holder, key, places)
    return content


def data(rng: random.Random, content: bytes) -> bytes:
    """The bytes with some changed, taken out, put in or moved."""
    changed = bytearray(content)
    for _ in range(rng.choice((1, 1, 1, 1, 2, 3, 8, 30))):
        size = max(len(changed), 1)
        at, length = rng.randrange(size), rng.choice((1, 2, 4, 16, 200))
        match rng.randrange(8):
            case 0 | 1 if changed:
                changed[at] ^= 1 << rng.randrange(8)
            case 2 if changed:
                changed[at] = rng.choice((0, 0x7F, 0x80, 0xFF, 0x0A, 0x2C))
            case 3:
                del changed[at : at + length]
            case 4:
                changed[at:at] = rng.randbytes(length)
            case 5:
                changed[at:at] = changed[at : at + length] * rng.choice((1, 3, 50))
            case 6:
                changed[at : at + 4] = rng.choice(
                    (b"\xff\xff\xff\x7f", b"\xff\xff\xff\xff", b"\0\0\0\0", b"\0\0\0\x80")
                )
            case _:
                if rng.random() < 0.3:
                    del changed[at:]
                else:
                    changed[at : at + 1] = rng.choice((b"nan", b"-", b"1e999", b",", b"\n", b'"', b"\xe9", b"\0"))
    return bytes(changed)


def xml(rng: random.Random, text: str) -> bytes:
    """An XML file with some attributes and elements changed, or some of its bytes."""
    if rng.random() < 0.2:
        return data(rng, text.encode())
    root = ET.fromstring(text)
    for _ in range(rng.choice((1, 1, 2, 3))):
        elements = list(root.iter())
        element = rng.choice(elements)
        names = list(element.attrib)
        match rng.randrange(6):
            case 0 if names:
                del element.attrib[rng.choice(names)]
            case 1 | 2 if names:
                element.set(rng.choice(names), rng.choice(XML_TEXTS))
            case 3 if names:
                other = rng.choice([e for e in elements if e.attrib] or [element])
                element.set(rng.choice(names), rng.choice(list(other.attrib.values()) or [""]))
            case 4 if len(element):
                child = rng.choice(list(element))
                element.remove(child)
                for _ in range(rng.choice((0, 2, 2, 40))):
                    element.append(copy.deepcopy(child))
            case _:
                parent = rng.choice(elements)
                if element is not root and element not in parent.iter():
                    parent.append(copy.deepcopy(element))
                else:
                    element.tag = rng.choice([e.tag for e in elements])
    return ET.tostring(root, encoding="utf-8", xml_declaration=True)
