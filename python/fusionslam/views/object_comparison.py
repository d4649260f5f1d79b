# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Compares views by their objects (Stastny 2022, section 4.5)."""

import numpy as np

from fusionslam.views.comparison import Candidate, SceneComparison, View
from fusionslam.views.scenes import (
    Scene,
    SceneConfig,
    SceneIndex,
    SimilarityConfig,
)


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
