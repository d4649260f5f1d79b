# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Compares views by aligning their range images: the default.

The stored views with the most similar thumbnails are aligned with the current view. The
probability that both show the same place follows from what each should have seen of the other.
"""

from collections.abc import Sequence

import numpy as np

from fusionslam._core import AlignmentConfig, AlignmentIndex
from fusionslam.errors import ConfigError, DataError
from fusionslam.views.comparison import Candidate, Item, SceneComparison, View
from fusionslam.views.scenes import Scene, SceneConfig

FEWEST_CELLS = 10
"""Fewest cells of a range image that can be aligned."""


class AlignmentComparison(SceneComparison):
    """Compares scenes by their range images; nothing else of a scene is stored.

    Args:
        scene: how scenes with range images are built from clouds.
        alignment: how scenes are aligned.
        default_threshold: the lowest probability of a match if the configuration gives none.
        threads: as in ``SceneComparison``.

    Raises:
        ConfigError: the scenes have no range images.
    """

    kind = "alignment"
    measure = "probability"

    def __init__(
        self,
        scene: SceneConfig,
        alignment: AlignmentConfig,
        default_threshold: float,
        *,
        threads: int = 1,
    ) -> None:
        self._alignment = alignment
        if not scene.image:
            raise ConfigError(
                "scene.image is False, and alignment needs range images: preset robust has them, "
                "others with views.scene.image=true",
                code="no-range-image",
            )
        super().__init__(scene, default_threshold, threads)

    def _empty_index(self) -> AlignmentIndex:
        return AlignmentIndex(self._alignment)

    def view(self, item: Item) -> View:
        scene = super().view(item).content
        distances = np.linalg.norm(scene.objects["center"], axis=1)
        in_range = (distances < self._scene.longest_range).any()
        if isinstance(item, Scene) and not len(scene.image) and in_range:
            raise DataError(
                "the scene has objects but no range image: build it with image=True, as the "
                "robust preset does, or compare objects (views.method=objects)",
                code="no-range-image",
            )
        return View(scene, self._recognisable(scene))

    def _recognisable(self, scene: Scene) -> int:
        return len(scene) if len(scene.image) >= FEWEST_CELLS else 0

    def compare(self, view: View, most: int) -> list[Candidate]:
        found = self._index.query(view.content, threads=self._threads)[:most]
        return [Candidate(slot, a.probability, (a.x, a.y, a.yaw)) for slot, a in found]

    def compare_near(self, view: View, slots: Sequence[int], most: int) -> list[Candidate]:
        """Up to ``most`` stored views, best first: those of some slots, and the most similar."""
        found = self._index.query_near(view.content, slots, most, threads=self._threads)
        return [Candidate(slot, a.probability, (a.x, a.y, a.yaw)) for slot, a in found]

    def _encode(self, scene: Scene) -> bytes:
        return Scene(scene.objects[:0], scene.image).to_bytes()
