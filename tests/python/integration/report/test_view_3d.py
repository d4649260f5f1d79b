# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
import base64
import io
import json
import re
import struct
from typing import Any

import numpy as np
import pytest

from fusionslam import Cloud, DataError
from fusionslam.report.place_maps import view_3d
from fusionslam.report.place_maps.view_3d import draw_view_3d

pytest.importorskip("matplotlib", reason="heights are coloured by it")

RNG = np.random.default_rng(1)
POINTS = RNG.uniform(-10, 10, (500, 3)).astype(np.float32)
COLORS = RNG.integers(0, 256, (500, 3), dtype=np.uint8)
TRACK = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 2.0, 0.0]])


def read_binary(page: str) -> bytes:
    """The scene in the page, as glTF."""
    return base64.b64decode(max(re.findall(r'"([A-Za-z0-9+/=]{500,})"', page), key=len))


def load_scene(page: str) -> Any:
    """The scene in the page, as another program reads it."""
    import trimesh

    return trimesh.load(io.BytesIO(read_binary(page)), file_type="glb")


def test_the_page_holds_cloud_and_trajectory() -> None:
    page = draw_view_3d(Cloud(POINTS, COLORS), {"monday": TRACK})
    shown = load_scene(page).geometry
    np.testing.assert_allclose(shown["cloud"].vertices, POINTS, atol=1e-5)
    np.testing.assert_array_equal(shown["cloud"].colors[:, :3], COLORS)
    length = sum(each.length for name, each in shown.items() if name.startswith("monday"))
    assert length == pytest.approx(3)


def test_lines_have_their_colours() -> None:
    lines = [(TRACK[:2], "#ff8000"), (TRACK[1:], "#00ff00"), (TRACK[:2] + 5, "#ff8000")]
    binary = read_binary(draw_view_3d(Cloud(POINTS, None), {}, lines))
    (length,) = struct.unpack_from("<I", binary, 12)
    content = json.loads(binary[20 : 20 + length])
    ends = {}
    for mesh in content["meshes"]:
        (shape,) = mesh["primitives"]
        if shape["mode"] == 1:  # separate lines, so that loops do not hang together
            ends[mesh["name"]] = content["accessors"][shape["attributes"]["POSITION"]]["count"]
    assert ends == {"loops #ff8000": 4, "loops #00ff00": 2}


def test_some_of_too_many_points_are_shown_and_an_empty_map_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(view_3d, "MOST_POINTS", 100)
    page = draw_view_3d(Cloud(POINTS, None), {})
    assert not re.findall(r"<(?:script|link|img)[^>]*(?:src|href)=", page)
    assert len(load_scene(page).geometry["cloud"].vertices) == 100
    empty = Cloud(np.empty((0, 3), np.float32), None)
    with pytest.raises(DataError, match="neither points"):
        draw_view_3d(empty, {"monday": TRACK[:1]})
