# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The joint maps of sites, read when they are asked for and kept until their files change."""

import logging
import threading
from contextlib import suppress
from pathlib import Path

from fusionslam.errors import FusionSlamError, one_line
from fusionslam.fleet.joint_map import JointMap
from fusionslam.fleet.site_maps import site_map_path

logger = logging.getLogger(__name__)

_MOST = 32
"""Maps in memory, some 150 bytes a keyframe."""

_Identity = tuple[tuple[int, int, int], ...]


class JointMaps:
    """Reads the maps that ``fusionslam fleet merge`` makes; may be used by several threads.

    Args:
        folder: of ``fusionslam fleet``.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._lock = threading.Lock()
        self._known: dict[str, tuple[_Identity, JointMap | None]] = {}
        self._lacks_extra = False

    def get(self, site: str) -> JointMap | None:
        """Return the joint map of a site as its file is now.

        None if there is none, if it cannot be read, which the log says once, or if the extra
        ``map`` is not installed.
        """
        path = site_map_path(self._folder, site)
        identity = _identity(path)
        if not identity:
            if site in self._known:
                with self._lock:
                    self._known.pop(site, None)
            return None
        known = self._known.get(site)
        if known is None or known[0] != identity:
            with self._lock:  # one at a time: reading takes more memory than what is kept
                known = self._known.get(site)
                if known is None or known[0] != identity:
                    known = self._known[site] = identity, self._read(path)
                    if len(self._known) > _MOST:
                        del self._known[next(iter(self._known))]
        return known[1]

    def _read(self, path: Path) -> JointMap | None:
        try:
            return JointMap.read(path)
        except FusionSlamError as error:
            if error.code == "missing-extra":
                if not self._lacks_extra:
                    logger.warning("joint maps are not shown: %s", one_line(error))
                self._lacks_extra = True
            else:
                logger.warning("the joint map %s is not shown: %s", path, one_line(error))
        return None


def _identity(path: Path) -> _Identity:
    """Return numbers that change with a map's file or its log of changes; none without a file."""
    try:
        found, log = [path.stat()], path.with_name(f"{path.name}-wal")
        with suppress(FileNotFoundError):
            found.append(log.stat())
    except OSError:
        return ()
    # Readers leave an empty log for a moment.
    changed = [each for each in found if each is found[0] or each.st_size]
    return tuple((each.st_ino, each.st_mtime_ns, each.st_ctime_ns) for each in changed)
