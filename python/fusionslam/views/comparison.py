# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""By what views are compared: objects, or a descriptor."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from fusionslam.errors import DataError, ShapeError
from fusionslam.sensors.frame import Cloud
from fusionslam.views.scene_set import pack_bytes, scene_values, unpack_bytes
from fusionslam.views.scenes import (
    Scene,
    SceneConfig,
    build_scene,
    scene_from_arrays,
    scene_to_arrays,
)

Arrays = Mapping[str, NDArray[Any]]
Item = Cloud | Scene | NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class View:
    """What a comparison makes of a scan.

    Attributes:
        content: whatever the comparison compares.
        objects: number of things that the place can be recognised by.
    """

    content: Any
    objects: int


@dataclass(frozen=True)
class Candidate:
    """A stored view that is like the current one.

    Attributes:
        slot: its place among those stored now.
        similarity: in [0, 1].
        relative_pose: x, y in metres and yaw in radians of the current view in the frame of the
            stored one, where the comparison finds it.
        rejected: whether it is no match, however similar.
    """

    slot: int
    similarity: float
    relative_pose: tuple[float, float, float] | None = None
    rejected: bool = False


class Comparison(Protocol):
    """Compares views with stored ones. Slots count those stored now, from the oldest on.

    Attributes:
        kind: its name in saved files.
        threshold: the similarity from which views match, if the configuration names none.
    """

    kind: str
    threshold: float

    def made_with(self) -> dict[str, Any]:
        """All that views depend on, as JSON can hold it: the like is needed to compare them."""

    def view(self, item: Item) -> View:
        """What is compared of a cloud, or of what was made of it.

        Raises:
            DataError: NaN, or what the comparison needs is missing. ShapeError: it cannot
                compare what is given.
        """

    def scene(self, view: View) -> Scene | None:
        """The objects that a view was made of; None where none were looked for."""

    def arrays_of(self, view: View) -> dict[str, NDArray[Any]]:
        """A view, exact, as arrays that ``view_of`` reads: to compare it in another process."""

    def view_of(self, arrays: Arrays) -> View:
        """The view that ``arrays_of`` took apart, to the bit.

        Raises:
            DataError, ShapeError, KeyError: the arrays are none of this comparison's.
        """

    def compare(self, view: View, most: int) -> list[Candidate]:
        """Up to ``most`` stored views, best first; equal ones in the order of storing."""

    def add(self, view: View) -> int:
        """Store a view; returns the bytes that it takes in a file."""

    def remove(self, slot: int) -> None:
        """Forget a stored view; those after it move up."""

    def size_of(self, slot: int) -> int:
        """Bytes that a stored view takes in a file."""

    def explain(self, similarity: float, threshold: float) -> str:
        """The two numbers that were compared, in words: "similarity 0.91 >= 0.74"."""

    def state(self) -> dict[str, NDArray[Any]]:
        """All stored views, as arrays that ``restore`` reads."""

    def restore(self, state: Arrays) -> None:
        """Go on from ``state``. Raises DataError or KeyError if it is none."""

    def __len__(self) -> int:
        """Number of stored views."""


def in_words(what: str, similarity: float, threshold: float) -> str:
    """A similarity and what it was compared with."""
    sign = ">=" if similarity >= threshold else "<"
    return f"{what} {similarity:.4g} {sign} {threshold:.4g}"


class SceneComparison(ABC):
    """Scenes, stored as their bytes: what is saved and what is compared are the same.

    Args:
        scene: how clouds become scenes.
        threshold: as ``Comparison``.
    """

    kind: str

    def __init__(self, scene: SceneConfig, threshold: float) -> None:
        self.threshold = threshold
        self._scene = scene
        self._bytes: list[bytes] = []
        self._index = self._empty_index()

    def __len__(self) -> int:
        return len(self._bytes)

    @abstractmethod
    def _empty_index(self) -> Any:
        """What compares scenes: it has add(scene) and remove(number)."""

    @abstractmethod
    def _encode(self, scene: Scene) -> bytes:
        """What is kept of a scene."""

    def made_with(self) -> dict[str, Any]:
        """How clouds become scenes."""
        return {f"scene.{name}": value for name, value in scene_values(self._scene).items()}

    def view(self, item: Item) -> View:
        """A scene, or the scene of a cloud."""
        if isinstance(item, Cloud):
            if item.colors is None:
                raise DataError("scenes need colours and the cloud has none")
            item = build_scene(item.points, item.colors, config=self._scene)
        if not isinstance(item, Scene):
            raise ShapeError(f"expected a Scene or a Cloud, got {type(item).__name__}")
        return View(item, self._recognisable(item))

    def _recognisable(self, scene: Scene) -> int:
        """Number of things that the place can be recognised by."""
        return len(scene)

    def scene(self, view: View) -> Scene:
        """All of the view."""
        made: Scene = view.content
        return made

    def arrays_of(self, view: View) -> dict[str, NDArray[Any]]:
        """As ``scene_to_arrays``."""
        return scene_to_arrays(view.content)

    def view_of(self, arrays: Arrays) -> View:
        """As ``Comparison``."""
        scene = scene_from_arrays(arrays)
        return View(scene, self._recognisable(scene))

    def add(self, view: View) -> int:
        """Store the scene."""
        self._append(self._encode(view.content))
        return len(self._bytes[-1])

    def _append(self, stored: bytes) -> None:
        self._index.add(Scene.from_bytes(stored))
        self._bytes.append(stored)

    def remove(self, slot: int) -> None:
        """Forget a scene."""
        self._index.remove(slot)
        del self._bytes[slot]

    def size_of(self, slot: int) -> int:
        """Bytes of a scene."""
        return len(self._bytes[slot])

    def state(self) -> dict[str, NDArray[Any]]:
        """The bytes of all scenes, and where each begins."""
        joined, offsets = pack_bytes(self._bytes)
        return {"scenes": joined, "offsets": offsets}

    def restore(self, state: Arrays) -> None:
        """As ``Comparison``."""
        self._bytes, self._index = [], self._empty_index()
        for stored in unpack_bytes(state["scenes"], state["offsets"]):
            self._append(stored)
