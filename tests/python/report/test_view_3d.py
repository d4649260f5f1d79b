# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
import base64
import io
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fusionslam import Cloud, DataError
from fusionslam.report.place_maps import view_3d
from fusionslam.report.place_maps.view_3d import write_view_3d

RNG = np.random.default_rng(1)
POINTS = RNG.uniform(-10, 10, (500, 3)).astype(np.float32)
COLORS = RNG.integers(0, 256, (500, 3), dtype=np.uint8)
TRACK = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 2.0, 0.0]])


def load_scene(page: Path) -> Any:
    """The scene in the page, as another program reads it."""
    import trimesh

    longest = max(re.findall(r'"([A-Za-z0-9+/=]{500,})"', page.read_text()), key=len)
    return trimesh.load(io.BytesIO(base64.b64decode(longest)), file_type="glb")


def test_the_page_holds_cloud_and_trajectory(tmp_path: Path) -> None:
    page = write_view_3d(tmp_path / "map.html", Cloud(POINTS, COLORS), {"monday": TRACK})
    shown = load_scene(page).geometry
    np.testing.assert_allclose(shown["cloud"].vertices, POINTS, atol=1e-5)
    np.testing.assert_array_equal(shown["cloud"].colors[:, :3], COLORS)
    length = sum(each.length for name, each in shown.items() if name.startswith("monday"))
    assert length == pytest.approx(3)


def test_the_page_asks_for_nothing_from_elsewhere(tmp_path: Path) -> None:
    page = write_view_3d(tmp_path / "map.html", Cloud(POINTS, None), {}).read_text()
    assert not re.findall(r"<(?:script|link|img)[^>]*(?:src|href)=", page)


def test_of_too_many_points_some_are_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(view_3d, "MOST_POINTS", 100)
    page = write_view_3d(tmp_path / "map.html", Cloud(POINTS, None), {})
    assert len(load_scene(page).geometry["cloud"].vertices) == 100


def test_an_empty_map_is_refused(tmp_path: Path) -> None:
    empty = Cloud(np.empty((0, 3), np.float32), None)
    with pytest.raises(DataError, match="neither points"):
        write_view_3d(tmp_path / "map.html", empty, {"monday": TRACK[:1]})


def test_a_page_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(DataError, match=r"map\.html"):
        write_view_3d(tmp_path / "file" / "map.html", Cloud(POINTS, None), {})
