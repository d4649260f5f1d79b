# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Compares maps that last."""

from pathlib import Path

import numpy as np

from fusionslam.mapping import PlaceMap


def assert_same_map(path: Path, other: Path) -> None:
    """Sessions, poses and edges of two maps are the same, and the first one is sound."""
    with PlaceMap.open(path, read_only=True) as found, PlaceMap.open(other, read_only=True) as site:
        assert found.check() == [] and found.sessions == site.sessions
        for session in (each.name for each in site.sessions):
            stamps, poses = found.trajectory(session)
            wanted_stamps, wanted = site.trajectory(session)
            assert stamps.tolist() == wanted_stamps.tolist()
            assert found.frames(session).tolist() == site.frames(session).tolist()
            np.testing.assert_allclose(poses, wanted, rtol=0, atol=1e-9)
        assert len(found.edges) == len(site.edges)
        for edge, same in zip(found.edges, site.edges, strict=True):
            assert (edge.kind, edge.a, edge.b, edge.state) == (
                same.kind,
                same.a,
                same.b,
                same.state,
            )
            np.testing.assert_allclose(edge.pose, same.pose, rtol=0, atol=1e-9)
            np.testing.assert_allclose(edge.covariance, same.covariance, rtol=1e-6, atol=1e-12)
