# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The interface of view comparisons, the base of those that compare scenes, and that by objects."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from fusionslam.errors import ShapeError
from fusionslam.sensors.frame import Cloud
from fusionslam.views.scene_set import pack_bytes, scene_values, unpack_bytes
from fusionslam.views.scenes import (
    Scene,
    SceneConfig,
    SceneIndex,
    SimilarityConfig,
    scene_from_arrays,
    scene_of_cloud,
    scene_to_arrays,
)

Arrays = Mapping[str, NDArray[Any]]
Item = Cloud | Scene | NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class View:
    """A scan in the form that a comparison uses.

    Attributes:
        content: the data compared; its type depends on the comparison.
        objects: number of objects that the place can be recognised by.
    """

    content: Any
    objects: int


@dataclass(frozen=True)
class Candidate:
    """A stored view that resembles the current one.

    Attributes:
        slot: its index among the views stored now.
        similarity: in [0, 1].
        relative_pose: x, y in metres and yaw in radians of the current view in the frame of the
            stored one; None if the comparison does not estimate it.
        rejected: True if it is not a match, however similar.
    """

    slot: int
    similarity: float
    relative_pose: tuple[float, float, float] | None = None
    rejected: bool = False


@runtime_checkable
class Comparison(Protocol):
    """Compares views with stored ones. Slots index the views stored now, oldest first.

    Attributes:
        kind: its name in saved files.
        default_threshold: the lowest similarity of a match if the configuration gives none.
    """

    kind: str
    default_threshold: float

    def settings(self) -> dict[str, Any]:
        """Every setting that views depend on, as JSON values; comparable views share them."""

    def view(self, item: Item) -> View:
        """The view of a cloud, or of data already computed from one.

        Raises:
            DataError: NaN, or data that the comparison needs are missing. ShapeError: the
                comparison does not accept this item.
        """

    def scene(self, view: View) -> Scene | None:
        """The scene of a view; None if the comparison does not extract objects."""

    def arrays_of(self, view: View) -> dict[str, NDArray[Any]]:
        """A view as exact arrays for ``view_of``, so that another process can compare it."""

    def view_of(self, arrays: Arrays) -> View:
        """Rebuild a view from ``arrays_of``, bit for bit.

        Raises:
            DataError, ShapeError, KeyError: the arrays are not from this kind of comparison.
        """

    def compare(self, view: View, most: int) -> list[Candidate]:
        """Up to ``most`` stored views, best first; ties in the order of storing."""

    def add(self, view: View) -> int:
        """Store a view; returns its size in a file in bytes."""

    def remove(self, slot: int) -> None:
        """Remove a stored view; later slots move down by one."""

    def size_of(self, slot: int) -> int:
        """Size of a stored view in a file, in bytes."""

    def explain(self, similarity: float, threshold: float) -> str:
        """The comparison with the threshold as text, such as "similarity 0.91 >= 0.74"."""

    def state(self) -> dict[str, NDArray[Any]]:
        """All stored views as arrays for ``restore``."""

    def restore(self, state: Arrays) -> None:
        """Resume from ``state``. Raises DataError or KeyError if the arrays are invalid."""

    def __len__(self) -> int:
        """Number of stored views."""


class SceneComparison(ABC):
    """Compares scenes, stored as bytes, so that a saved matcher compares the same data.

    Args:
        scene: how scenes are built from clouds.
        default_threshold: as in ``Comparison``.
        threads: number of threads for comparison; 0 means one per core.

    Attributes:
        measure: what the similarity is called in texts.
    """

    kind: str
    measure: str

    def __init__(self, scene: SceneConfig, default_threshold: float, threads: int) -> None:
        self.default_threshold = default_threshold
        self._scene, self._threads = scene, threads
        self._bytes: list[bytes] = []
        self._index = self._empty_index()

    def __len__(self) -> int:
        return len(self._bytes)

    def __getstate__(self) -> dict[str, Any]:
        return {k: v for k, v in vars(self).items() if k != "_index"} | {"_bytes": [*self._bytes]}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self.restore(self.state())

    @abstractmethod
    def _empty_index(self) -> Any:
        """A new index of scenes with ``add(scene)`` and ``remove(number)``."""

    @abstractmethod
    def _encode(self, scene: Scene) -> bytes:
        """The bytes to store for a scene."""

    def settings(self) -> dict[str, Any]:
        return {f"scene.{name}": value for name, value in scene_values(self._scene).items()}

    def view(self, item: Item) -> View:
        if isinstance(item, Cloud):
            item = scene_of_cloud(item, self._scene)
        if not isinstance(item, Scene):
            raise ShapeError(f"expected a Scene or a Cloud, got {type(item).__name__}")
        return View(item, self._recognisable(item))

    def _recognisable(self, scene: Scene) -> int:
        """Number of objects that the place can be recognised by."""
        return len(scene)

    def scene(self, view: View) -> Scene:
        scene: Scene = view.content
        return scene

    def arrays_of(self, view: View) -> dict[str, NDArray[Any]]:
        return scene_to_arrays(view.content)

    def view_of(self, arrays: Arrays) -> View:
        scene = scene_from_arrays(arrays)
        return View(scene, self._recognisable(scene))

    def add(self, view: View) -> int:
        self._append(self._encode(view.content))
        return len(self._bytes[-1])

    def _append(self, stored: bytes) -> None:
        self._index.add(Scene.from_bytes(stored))
        self._bytes.append(stored)

    def remove(self, slot: int) -> None:
        self._index.remove(slot)
        del self._bytes[slot]

    def size_of(self, slot: int) -> int:
        return len(self._bytes[slot])

    def state(self) -> dict[str, NDArray[Any]]:
        joined, offsets = pack_bytes(self._bytes)
        return {"scenes": joined, "offsets": offsets}

    def restore(self, state: Arrays) -> None:
        self._bytes, self._index = [], self._empty_index()
        for stored in unpack_bytes(state["scenes"], state["offsets"]):
            self._append(stored)

    def explain(self, similarity: float, threshold: float) -> str:
        sign = ">=" if similarity >= threshold else "<"
        return f"{self.measure} {similarity:.4g} {sign} {threshold:.4g}"


class ObjectComparison(SceneComparison):
    """Compares scenes by their objects (Stastny 2022, 4.6).

    Args:
        similarity: how scenes are compared.
        scene, default_threshold, threads: as in ``SceneComparison``.
    """

    kind = "objects"
    measure = "similarity"

    def __init__(
        self,
        scene: SceneConfig,
        similarity: SimilarityConfig,
        default_threshold: float,
        *,
        threads: int = 1,
    ) -> None:
        self._similarity = similarity
        super().__init__(scene, default_threshold, threads)

    def _empty_index(self) -> SceneIndex:
        return SceneIndex(self._similarity)

    def _encode(self, scene: Scene) -> bytes:
        return scene.to_bytes(image=False)

    def compare(self, view: View, most: int) -> list[Candidate]:
        found = self._index.similarities(view.content, threads=self._threads)
        if most == 1 and len(found):
            best = int(found.argmax())
            return [Candidate(best, float(found[best]))]
        order = np.argsort(-found, kind="stable")[:most]
        return [Candidate(int(slot), float(found[slot])) for slot in order]
