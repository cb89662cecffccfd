"""Hostile inputs made of sound ones: bytes, MessagePack trees, text; each a function of a random generator alone."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping, Sequence
from random import Random
from typing import TypeAlias

import msgpack

Node: TypeAlias = object
"""None, bool, int, float, str, bytes, list, dict, ``Pairs``, ``Raw`` or ``ExtType``: what a payload can carry."""


Snapshot: TypeAlias = dict[str, bytes | int]


class Raw(bytes):
    """Bytes that stand in a payload as they are, whatever they claim to be."""


class Pairs(list[tuple[Node, Node]]):
    """A map that may have a key twice, and keys of any type."""


INTEGERS = (-1, 0, 1, 63, 64, 255, 2**31, 2**53, 2**62, 2**62 + 1, 2**63 - 1, 2**63, 2**64 - 1, -(2**63))
FLOATS = (math.nan, math.inf, -math.inf, -0.0, 5e-324, 1e-300, 1.000001, 1e5, 1e12, 1.1e12, 1e308, -1e308)
TEXTS = (
    "",
    "\0",
    "a\nb",
    "\x1b[2J\x1b[31m",
    "../../etc/passwd",
    "treenail/**",
    "$*?#",
    "-1",
    "NaN",
    "__class__",
    "{0.__init__}",
    "%s%n",
    "'; DROP TABLE entry; --",
    "\u202e\u0666\ufeff",
    "\U0010ffff",
    "a" * 81,
    "x" * 5000,
)
_BLOCKS = (b"", b"\0", b"\x80\x04N.", b"\xff" * 8, b"\0\0\0\0\0\0\xf8\x7f", b"\0\0\0\0\0\0\xf0\x7f", b"\x7f" * 48)
_ITEM_BYTES = 8
_PACKER = msgpack.Packer(buf_size=4096)
_CHANGES = (1, 1, 1, 2, 4)
_HEADS = (b"\xdd", b"\xdf", b"\xdb", b"\xc6", b"\xc9")
_LENGTHS = (b"\xff\xff\xff\xff", b"\x7f\xff\xff\xff", b"\x00\x01\x00\x00", b"\x04\x00\x00\x00")
_RAW = (
    b"\xc1",
    b"\xa3\xed\xa0\x80",
    b"\xa2\xc3\x28",
    b"\xd9\x02\xff\xfe",
    b"\xd6\xff\x00\x00\x00\x00",
    b"\xc7\x03\xff\x00\x00\x00",
    b"\xd4\x05\x00",
    b"\x81\xc0\xc0",
    b"\x81\x90\x01",
    b"\xcf\x00\x00\x00\x00\x00\x00\x00\x01",
    b"\xca\x3f\x80\x00\x00",
    b"\xdc\x00\x03\xc0\xc0\xc0",
    b"\x91" * 600 + b"\xc0",
    b"\x81\xa3run" * 600 + b"\xc0",
    b"\x91" * 5000,
    b"\xdc\x40\x00" + b"\x90" * 0x4000,
)


def pack(node: Node) -> bytes:
    """Return the MessagePack bytes of a value, well-formed or not."""
    if isinstance(node, Raw):
        return bytes(node)
    if isinstance(node, dict | Pairs):
        pairs = list(node.items()) if isinstance(node, dict) else node
        head: bytes = _PACKER.pack_map_header(len(pairs))
        return head + b"".join(pack(key) + pack(value) for key, value in pairs)
    if isinstance(node, list | tuple):
        head = _PACKER.pack_array_header(len(node))
        return head + b"".join(map(pack, node))
    try:
        packed: bytes = _PACKER.pack(node)
    except OverflowError:  # a whole number beyond what MessagePack has
        _PACKER.reset()
        return b"\xcf" + b"\xff" * 8
    return packed


def hostile_value(rng: Random) -> Node:
    """Return a value that is seldom welcome anywhere."""
    makers: tuple[Callable[[], Node], ...] = (
        lambda: rng.choice((None, True, False)),
        lambda: rng.choice(INTEGERS),
        lambda: rng.choice(FLOATS),
        lambda: rng.choice(TEXTS),
        lambda: rng.choice(_BLOCKS),
        lambda: [hostile_value(rng) for _ in range(rng.randrange(4))],
        lambda: {text: hostile_value(rng) for text in rng.sample(TEXTS, rng.randrange(3))},
        lambda: Raw(rng.choice(_RAW)),
        lambda: Raw(rng.choice(_HEADS) + rng.choice(_LENGTHS)),
        lambda: msgpack.ExtType(rng.randrange(128), rng.choice(_BLOCKS)),
    )
    return rng.choice(makers)()


def mutate_tree(rng: Random, node: Node) -> Node:
    """Return a tree with one part of it changed; the given one stays as it is."""
    if rng.random() < 0.75:
        if isinstance(node, dict) and node:
            key = rng.choice(list(node))
            return {**node, key: mutate_tree(rng, node[key])}
        if isinstance(node, list | tuple) and node:
            place = rng.randrange(len(node))
            return [*node[:place], mutate_tree(rng, node[place]), *node[place + 1 :]]
    if isinstance(node, dict) and node:
        return _broken_map(rng, node)
    if isinstance(node, list | tuple) and node:
        return _broken_list(rng, list(node))
    return hostile_value(rng) if rng.random() < 0.4 else _neighbour(rng, node)


def mutate_bytes(rng: Random, data: bytes) -> bytes:
    """Return bytes with up to four places changed."""
    changed = bytearray(data)
    for _ in range(rng.choice(_CHANGES)):
        place = rng.randrange(len(changed) + 1)
        choice = rng.randrange(8)
        if choice == 0:
            del changed[place:]
        elif choice == 1:
            del changed[place : place + rng.randint(1, 8)]
        elif choice == 2:
            changed[place:place] = rng.randbytes(rng.randint(1, 8))
        elif choice == 3:
            changed[place : place + 5] = rng.choice(_HEADS) + rng.choice(_LENGTHS)
        elif choice == 4:
            changed[place : place + 1] = rng.choice(_RAW)
        elif choice == 5:
            changed[place:place] = changed[place : place + rng.randint(1, 64)] * rng.randint(1, 8)
        elif changed and choice == 6:
            changed[place % len(changed)] ^= 1 << rng.randrange(8)
        elif changed:
            changed[place % len(changed)] = rng.randrange(256)
    return bytes(changed)


def mutate_payload(rng: Random, trees: Sequence[Node]) -> bytes:
    """Return a payload that a sound one has become: mostly by its structure, else byte by byte, or pure noise."""
    if rng.random() < 0.03:
        return rng.randbytes(rng.randrange(64))
    tree = rng.choice(trees)
    dice = rng.random()
    if dice < 0.65:
        for _ in range(rng.choice(_CHANGES)):
            tree = mutate_tree(rng, tree)
    payload = pack(tree)
    return payload if 0.1 <= dice < 0.65 else mutate_bytes(rng, payload)


def mutate_text(rng: Random, text: str, words: Sequence[str]) -> str:
    """Return a text with up to four places changed; ``words`` are what may be put into it."""
    for _ in range(rng.choice(_CHANGES)):
        place = rng.randrange(len(text) + 1)
        end = place + rng.randrange(8)
        choice = rng.randrange(6)
        if choice == 0:
            text = text[:place]
        elif choice == 1:
            text = text[:place] + text[end:]
        elif choice == 2:
            text = text[:place] + rng.choice(TEXTS) + text[end:]
        elif choice == 3:
            text = text[:place] + rng.choice(words) + text[end:]
        elif choice == 4:
            text = text[:place] + chr(rng.choice((rng.randrange(128), rng.randrange(0xD800)))) + text[place:]
        else:
            text = text[:place] + text[place:end] * rng.randint(2, 40) + text[end:]
    return text


def hostile_memory(rng: Random, sound: Mapping[str, bytes | int]) -> Snapshot:
    """Return a memory with up to three fields changed, of the types that a message can carry."""
    memory: Snapshot = dict(sound)
    for _ in range(rng.randint(1, 3)):
        key = rng.choice(list(memory) or [""])
        value = memory.get(key, 0)
        choice = rng.randrange(6)
        if choice == 0:
            memory.pop(key, None)
        elif choice == 1:
            memory[rng.choice(TEXTS)] = rng.choice(INTEGERS)
        elif choice == 2:
            memory[key] = rng.choice(INTEGERS)
        elif choice == 3:
            memory[key] = rng.choice((b"", b"\0" * 8, rng.randbytes(48)))
        elif isinstance(value, bytes):
            memory[key] = mutate_bytes(rng, value) if choice == 4 else _one_item(rng, value)
        else:
            memory[key] = min(2**64 - 1, max(0, value + rng.choice((-1, 1))))
    return memory


def _broken_map(rng: Random, node: dict[Node, Node]) -> Node:
    pairs = Pairs(node.items())
    place = rng.randrange(len(pairs))
    key, value = pairs[place]
    choice = rng.randrange(7)
    if choice == 0:
        del pairs[place]
    elif choice == 1:
        pairs.append((key, value))
    elif choice == 2:
        pairs.append((key, mutate_tree(rng, value)))
    elif choice == 3:
        pairs[place] = (hostile_value(rng), value)
    elif choice == 4:
        pairs.append((hostile_value(rng), hostile_value(rng)))
    elif choice == 5:
        rng.shuffle(pairs)
    else:
        return hostile_value(rng)
    return pairs


def _broken_list(rng: Random, node: list[Node]) -> Node:
    choice = rng.randrange(5)
    if choice == 0:
        del node[rng.randrange(len(node))]
    elif choice == 1:
        node.append(rng.choice(node))
    elif choice == 2:
        node.append(hostile_value(rng))
    elif choice == 3:
        return node * rng.choice((2, 3, 70))
    else:
        return hostile_value(rng)
    return node


def _neighbour(rng: Random, leaf: Node) -> Node:
    """Return a value like the one given, but not quite."""
    if isinstance(leaf, bool) or leaf is None:
        return rng.choice((None, True, False, 0))
    if isinstance(leaf, int):
        return rng.choice((leaf + 1, leaf - 1, -leaf, leaf << 8 & 2**64 - 1, float(leaf), str(leaf)))
    if isinstance(leaf, float):
        far = rng.choice(FLOATS)
        return rng.choice((-leaf, math.nextafter(leaf, math.inf), leaf * 1e3, far, 1, str(leaf)))
    if isinstance(leaf, str):
        return rng.choice(
            (leaf[1:], leaf + leaf, leaf.upper(), leaf + "\n", leaf.encode(), mutate_text(rng, leaf, TEXTS))
        )
    if isinstance(leaf, bytes):
        return rng.choice((leaf[:-1], leaf[8:], leaf + leaf, leaf.hex(), mutate_bytes(rng, leaf)))
    return hostile_value(rng)


def _one_item(rng: Random, block: bytes) -> bytes:
    """Return a block of eight-byte numbers with one of them replaced by a hostile one."""
    place = rng.randrange(max(1, len(block) // _ITEM_BYTES)) * _ITEM_BYTES
    number = rng.choice(FLOATS)
    item = struct.pack("<d", number) if rng.random() < 0.6 else rng.choice(INTEGERS).to_bytes(9, "little", signed=True)
    return block[:place] + item[:_ITEM_BYTES] + block[place + _ITEM_BYTES :]
