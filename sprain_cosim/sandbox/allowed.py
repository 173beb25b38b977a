"""What a mapping file grants an FMU beyond the sandbox."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass

from ..errors import InputError, nearest

WORDS = ("loopback", "network", "exec")
PATTERN = f"^({'|'.join(WORDS)}|read:[/~].+)$"  # of one entry of the list


@dataclass(frozen=True)
class Allowed:
    """What a mapping file grants beyond the sandbox: `loopback` a network of its own in which only it and its children
    are, `network` the machine's, `execute` starting programs, `read` files and folders besides its own."""

    loopback: bool = False
    network: bool = False
    execute: bool = False
    read: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return self != NOTHING

    def __or__(self, other: Allowed) -> Allowed:
        read = tuple(dict.fromkeys(self.read + other.read))
        return Allowed(
            self.loopback or other.loopback, self.network or other.network, self.execute or other.execute, read
        )

    def words(self) -> list[str]:
        """As in a mapping file."""
        flags = zip(WORDS, (self.loopback, self.network, self.execute), strict=True)
        return [word for word, granted in flags if granted] + [f"read:{path}" for path in self.read]


NOTHING = Allowed()


def allowed(words: Iterable[object]) -> Allowed:
    """From the list `allow` of a mapping file: "loopback", "network", "exec", "read:/path". Raises InputError."""
    flags: set[str] = set()
    read: list[str] = []
    for word in words:
        if not isinstance(word, str):
            raise InputError(f"allow: {word!r}: must be text")
        if word.startswith("read:"):
            path = os.path.expanduser(word.removeprefix("read:"))
            if not os.path.isabs(path):
                raise InputError(f"allow: {word!r}: must be an absolute path, such as read:/opt/licence")
            read.append(os.path.normpath(path))
        elif word in WORDS:
            flags.add(word)
        else:
            raise InputError(f"allow: {word!r} is none of {', '.join(WORDS)}, read:/path{nearest(word, WORDS)}")
    return Allowed("loopback" in flags, "network" in flags, "exec" in flags, tuple(read))
