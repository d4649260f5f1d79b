# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Images of the cameras around a robot, which frames take along but can do without."""

from bisect import insort
from collections import Counter
from collections.abc import Iterable

from fusionslam.sensors.frame import Frame
from fusionslam.sensors.messages import NANOSECONDS, Picture, as_nanoseconds
from fusionslam.sensors.synchronizer import SyncConfig, choose_image


class SurroundImages:
    """The newest images of further cameras, one of which belongs to each frame.

    Which one is decided as by ``Synchronizer``. A camera that has been silent for longer than
    ``wait`` is waited for no more until its next image.

    Args:
        names: of the cameras.
        config: policy and limits.
        wait: how long a silent camera is waited for, in seconds of stamps.

    Attributes:
        missing: frames that lack an image, by camera.
    """

    def __init__(self, names: Iterable[str], config: SyncConfig, wait: float) -> None:
        self.names = tuple(names)
        self.missing: Counter[str] = Counter()
        self._config = config
        self._wait_ns = wait * NANOSECONDS
        self._reach_ns = as_nanoseconds("max_difference", config.max_difference)
        self._lateness_ns = as_nanoseconds("lateness", config.lateness)
        self._first_ns: int | None = None
        self._unplaced: set[str] = set()
        self._images: dict[str, list[tuple[int, Picture]]] = {name: [] for name in self.names}

    def add(self, name: str, picture: Picture) -> None:
        """Keep an image; of more than ``buffer`` the oldest is dropped."""
        images = self._images[name]
        if images and images[-1][0] - picture.stamp_ns > self._config.jump * NANOSECONDS:
            images.clear()
        insort(images, (picture.stamp_ns, picture), key=lambda image: image[0])
        del images[: -self._config.buffer]

    def is_settled(self, stamp_ns: int, newest_ns: int) -> bool:
        """Whether no better image of a scan is expected.

        Args:
            stamp_ns: of the scan.
            newest_ns: newest stamp of all sensors.
        """
        self._first_ns = stamp_ns if self._first_ns is None else min(self._first_ns, stamp_ns)
        return all(self._is_settled(name, stamp_ns, newest_ns) for name in self.names)

    def _is_settled(self, name: str, stamp_ns: int, newest_ns: int) -> bool:
        images = self._images[name]
        assert self._first_ns is not None
        last_ns = images[-1][0] if images else self._first_ns
        if newest_ns - last_ns > self._wait_ns:
            return True
        chosen = self._chosen(name, stamp_ns)
        ahead = self._reach_ns if chosen is None else abs(chosen.stamp_ns - stamp_ns)
        if ahead == 0 and chosen is not None:
            return True
        if self._config.policy == "last_before":
            ahead = 0
        return bool(images) and last_ns > stamp_ns + ahead + self._lateness_ns

    def choose(self, stamp_ns: int) -> dict[str, Picture]:
        """The images of a scan by camera, without the cameras that have none."""
        found = {name: self._chosen(name, stamp_ns) for name in self.names}
        return {name: picture for name, picture in found.items() if picture is not None}

    def count(self, frame: Frame) -> None:
        """Count what a frame lacks, and which of its cameras could not be placed."""
        self.missing.update(name for name in self.names if name not in frame.images)
        self._unplaced |= {name for name in self.names if name in frame.images}
        self._unplaced -= {*frame.cameras}

    @property
    def awaited(self) -> set[str]:
        """Cameras whose place is worth waiting for: it was known, or has not been asked for."""
        return {*self.names} - self._unplaced

    def forget(self) -> None:
        """Drop all images after the clock jumped back."""
        self._first_ns = None
        for images in self._images.values():
            images.clear()

    def _chosen(self, name: str, stamp_ns: int) -> Picture | None:
        images = self._images[name]
        stamps = [image[0] for image in images]
        row = choose_image(stamps, stamp_ns, self._config.policy, self._reach_ns)
        return None if row is None else images[row][1]
