"""Damage: damaged copies of a good file or message."""

import re
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

HUGE = (b"\xff" * 8, b"\xff\xff\xff\x7f\0\0\0\0", b"\0" * 8, b"\0\0\0\0\1\0\0\0", b"\xff\xff\xff\xff\xff\xff\xff\x7f")
_SOUND_SHARE = 0.1  # share of undamaged messages


class Sound(NamedTuple):
    """A valid payload of a request to a bench, or published by a node: `payload`, as text if `text`."""

    payload: bytes
    text: bool


def mutate(good: bytes, count: int, seed: int = 1) -> Iterator[bytes]:
    """Yield `count` damaged copies: cut, bytes changed, numbers made huge or zero, a part removed or duplicated."""
    random = np.random.default_rng(seed)
    for _ in range(count):
        content = bytearray(good)
        kind = random.integers(6)
        if kind == 0:
            del content[int(random.integers(1, len(content))) :]
        elif kind == 1:
            for place in random.integers(len(content), size=random.integers(1, 9)):
                content[place] = random.integers(256)
        elif kind == 2:
            place = 8 * int(random.integers(len(content) // 8))
            content[place : place + 8] = HUGE[random.integers(len(HUGE))]
        elif kind == 3:
            place = int(random.integers(len(content)))
            del content[place : place + int(random.integers(1, 200))]
        elif kind == 4:
            place, source = random.integers(len(content), size=2)
            content[place:place] = content[source : source + int(random.integers(1, 200))]
        else:  # bytes from elsewhere in the file: digits for digits in a text, so that it stays a text
            for place, source in random.integers(len(content), size=(random.integers(1, 9), 2)):
                content[place] = content[source]
        yield bytes(content)


_TOKEN = re.compile(rb"[\w.+-]+")
_ODD = (
    b"0", b"-0.0", b"-1", b"1e308", b"-1e308", b"1e-320", b"nan", b"inf", b"-inf", b"NaN", b"-Infinity", b"9" * 400,
    b"true", b"null", b"[]", b"{}", b'""', b'"a b"', b"[" * 300, "\u00b5\ud7ff".encode(), b"2026-11-26", b"0x10",
    b"x" * 70_000, b"a b " * 9_000, b'"a\\nb"', b'"\\u001b[2J"',
)  # fmt: skip


def mutate_text(good: bytes, count: int, seed: int = 1) -> Iterator[bytes]:
    """Yield `count` damaged copies of a text, most of them parsable: a word or number changed, a line doubled or removed."""
    random = np.random.default_rng(seed)
    for _ in range(count):
        content = good
        for _ in range(int(random.integers(1, 3))):
            kind = random.integers(4)
            if kind == 0:
                lines = content.split(b"\n")
                line = int(random.integers(len(lines)))
                lines[line : line + 1] = [lines[line]] * int(2 * random.integers(2))
                content = b"\n".join(lines)
                continue
            tokens = list(_TOKEN.finditer(content))
            if not tokens:
                break
            token = tokens[random.integers(len(tokens))]
            other = tokens[random.integers(len(tokens))].group() if kind == 1 else _ODD[random.integers(len(_ODD))]
            content = content[: token.start()] + other + content[token.end() :]
        yield content


def damage(sound: Sound, random: np.random.Generator, seed: int) -> bytes:
    """Return a damaged copy, or occasionally a sound one."""
    if random.random() < _SOUND_SHARE:
        return sound.payload
    damage = mutate_text if sound.text and random.random() < 0.8 else mutate
    return next(damage(sound.payload, 1, seed)) if len(sound.payload) >= 8 else sound.payload
