# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""API keys: who may use the service."""

import hashlib
import hmac
import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Self

from fusionslam.errors import ConfigError

VARIABLE = "FUSIONSLAM_API_KEYS"
"""Environment variable with keys, separated by spaces or lines."""
SHORTEST = 16
"""Characters of a key: SHA-256 protects keys that nobody can guess, not passwords."""
_DIGEST = re.compile(r"sha256:(?P<hex>[0-9a-f]{64})")


class ApiKeys:
    """The digests of the keys that are accepted; the keys themselves are not kept.

    A line of a file is a name and a key, or ``sha256:`` with the key's SHA-256 in hexadecimal, so
    that the file cannot be used to get in. Names are shown nowhere; they say whose key to remove.
    """

    def __init__(self, digests: Iterable[bytes] = ()) -> None:
        self._digests = tuple(digests)

    def __len__(self) -> int:
        return len(self._digests)

    @classmethod
    def load(cls, path: Path | None) -> Self:
        """Read the keys of a file and those of the environment.

        Raises:
            ConfigError: the file cannot be read or has none (code "config-file"), a line is not a
                name and a key ("bad-key"), or a key is too short ("short-key").
        """
        digests = [_digest_of(key, VARIABLE) for key in os.environ.get(VARIABLE, "").split()]
        if path is not None:
            digests += _read(path)
        return cls(digests)

    def find(self, key: str) -> str | None:
        """Return a name for the client with this key; None if it is none of ours.

        The time that this takes does not depend on the key.
        """
        given = hashlib.sha256(key.encode(errors="replace")).digest()
        found = None
        for digest in self._digests:
            if hmac.compare_digest(digest, given):
                found = digest.hex()
        return found


def _read(path: Path) -> list[bytes]:
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is no text"
        message = f"{path}: the API keys cannot be read: {reason}"
        raise ConfigError(message, code="config-file", fields=(str(path),)) from error
    digests = []
    for number, line in enumerate(lines, start=1):
        words = line.partition("#")[0].split()
        if not words:
            continue
        if len(words) != 2:
            message = f"{path}, line {number}: {len(words)} words, expected a name and a key"
            raise ConfigError(message, code="bad-key", fields=(str(path), str(number)))
        digests.append(_digest_of(words[1], f"{path}, line {number}"))
    if not digests:
        message = f"{path}: it holds no API key, expected lines with a name and a key"
        raise ConfigError(message, code="config-file", fields=(str(path),))
    return digests


def _digest_of(key: str, where: str) -> bytes:
    if found := _DIGEST.fullmatch(key):
        return bytes.fromhex(found["hex"])
    if len(key) < SHORTEST:
        message = f"{where}: the key has {len(key)} characters, expected {SHORTEST} or more"
        raise ConfigError(message, code="short-key", fields=(where,))
    return hashlib.sha256(key.encode()).digest()
