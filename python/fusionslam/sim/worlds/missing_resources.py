# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Collect the resources that a world refers to and that are missing or not supported."""

import logging
from pathlib import Path

from fusionslam.errors import DataError

log = logging.getLogger(__name__)


class Unresolved:
    """Collects missing resources, so that one message can list them all.

    Attributes:
        items: each missing resource once, like
            "texture floor.png: no such file beside models/hall/meshes/hall.dae".
    """

    def __init__(self) -> None:
        self.items: list[str] = []
        self._seen: set[tuple[str, str]] = set()

    def add(self, kind: str, name: str, why: str) -> None:
        """Record that ``name`` is missing; the first reason is kept."""
        if (kind, name) not in self._seen:
            self._seen.add((kind, name))
            self.items.append(f"{kind} {name}: {why}")

    def settle(self, path: Path, lenient: bool) -> tuple[str, ...]:
        """If lenient, log and return the missing resources.

        Raises:
            DataError: not lenient and something is missing; the message lists all of it.
        """
        if self.items and not lenient:
            listed = "".join(f"\n  {item}" for item in self.items)
            raise DataError(
                f"{path}: {len(self.items)} resources are missing or not supported, lenient "
                f"loading (--lenient) skips them{listed}",
                code="unresolved",
                fields=tuple(self.items),
            )
        for item in self.items:
            log.warning("%s: skipped %s", path, item)
        return tuple(self.items)
