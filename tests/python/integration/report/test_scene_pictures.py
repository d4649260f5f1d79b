# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of scenes show the objects that the core found, and join those that are alike."""

import dataclasses
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from bags import drive as bag_drive
from bags import write_bag
from cli import fails, last_line, succeeds
from error_codes import has_code
from fusionslam.errors import DataError, FusionSlamError
from fusionslam.sensors.frame import Cloud
from fusionslam.views import SceneConfig, SceneSet, SimilarityConfig, scene_similarity
from fusionslam.views.alignment_comparison import AlignmentConfig
from fusionslam.views.clusters import ClusteredScan, cluster_scan, object_similarities
from rows import rows
from scenes import NOTHING, drive, place, write_recording

pytest.importorskip("matplotlib")

from fusionslam.report.views.scene_figures import (
    draw_pair,
    draw_scene,
    outline,
    write_scene_picture,
)

PRESETS = ("robust", "paper", "author")


def cloud(seed: int, groups: int = 9) -> Cloud:
    """Groups of 3 to 60 points, some equally many, with floor and stray points in any order."""
    rng = np.random.default_rng(seed)
    sizes = [*rng.integers(3, 60, groups - 2).tolist(), 30, 30]
    centers = rng.uniform((1, -4, 0.3), (9, 4, 2), (groups, 3))
    parts = [c + rng.uniform(-0.2, 0.2, (n, 3)) for c, n in zip(centers, sizes, strict=True)]
    floor = np.column_stack([rng.uniform(1, 9, (80, 2)), np.full(80, 0.02)])
    points = np.concatenate([*parts, floor, rng.uniform(1, 9, (5, 3))])
    points = points[rng.permutation(len(points))].astype(np.float32)
    return Cloud(points, rng.integers(0, 40, (len(points), 3)).astype(np.uint8))


def scan(number: int, visit: int = 0, preset: str = "robust") -> ClusteredScan:
    return cluster_scan(number, place(number, visit), SceneConfig(preset=preset))


@rows("preset", PRESETS)
@rows("seed", range(4))
def test_points_of_objects_are_those_of_the_core(preset: str, seed: int) -> None:
    found = cluster_scan(seed, cloud(seed), SceneConfig(preset=preset))
    assert len(found.members) == len(found.scene) > 3
    for indices, thing in zip(found.members, found.scene.objects, strict=True):
        points = found.points[indices]
        assert len(points) == thing["points"]
        np.testing.assert_allclose(points.min(axis=0), thing["box_min"], atol=1e-6)
        np.testing.assert_allclose(points.max(axis=0), thing["box_max"], atol=1e-6)
    every = np.sort(np.concatenate([*found.members, found.loose]))
    assert every.tolist() == list(range(len(found.points)))


@rows("preset", PRESETS)
def test_the_similarities_of_objects_give_that_of_the_scenes(preset: str) -> None:
    config = SimilarityConfig(preset=preset)
    current, stored = scan(1, preset=preset).scene, scan(2, preset=preset).scene
    table = object_similarities(current, stored, config)
    covered = np.average(table.max(axis=1), weights=current.objects["points"])
    back = np.average(table.max(axis=0), weights=stored.objects["points"])
    whole = (covered + back) / 2 if config.symmetric else covered
    assert whole == pytest.approx(scene_similarity(current, stored, config=config), abs=1e-9)


def test_outlines_are_hulls_and_lines_where_there_is_no_hull() -> None:
    for points, ends in (
        ([[0, 0], [2, 0], [1, 1], [2, 2], [0, 2]], {(0, 0), (2, 0), (2, 2), (0, 2)}),
        ([[1, 5], [0, 6], [3, 3], [2, 4]], {(0, 6), (3, 3)}),
        ([[0, 1], [4, 1], [2, 1]], {(0, 1), (4, 1)}),
    ):
        assert {tuple(end) for end in outline(np.array(points, np.float64)).tolist()} == ends
    for count in (1, 5):
        assert outline(np.ones((count, 2))).tolist() == [[1, 1], [1, 1]]


def test_each_object_has_its_hull_and_its_number() -> None:
    panels = draw_scene(scan(3)).axes
    assert [len(panel.patches) for panel in panels] == [0, 3, 0, 3]
    assert [text.get_text() for text in panels[3].texts] == ["0", "1", "2"]
    assert panels[1].get_title(loc="left") or panels[1].get_title()


def test_a_line_joins_each_object_with_the_one_it_is_most_like() -> None:
    current, stored = scan(3, 0), scan(3, 1)
    figure = draw_pair(current, stored, SimilarityConfig())
    table = object_similarities(current.scene, stored.scene, SimilarityConfig())
    lines = [(line.xy1, line.xy2) for line in figure.artists]
    assert len(lines) == 3 and len(figure.axes) == 2
    for (begin, end), i, j in zip(lines, range(3), table.argmax(axis=1).tolist(), strict=True):
        left, right = current.scene.objects["center"][i], stored.scene.objects["center"][j]
        assert begin == pytest.approx((-left[1], left[0]))
        assert end == pytest.approx((-right[1], right[0]))


def test_the_way_back_is_drawn_where_it_ends_elsewhere_and_counts() -> None:
    three, one = scan(3), cluster_scan(9, place(3, 1, objects=1), SceneConfig())
    for symmetric, lines in ((True, 3), (False, 1)):
        config = SimilarityConfig(symmetric=symmetric)
        figure = draw_pair(one, three, config)
        styles = sorted(line.get_linestyle() for line in figure.artists)
        assert styles == ["-", *["--"] * (lines - 1)]


def test_aligned_scans_get_a_panel_of_their_own() -> None:
    figure = draw_pair(scan(3, 0), scan(3, 1), SimilarityConfig(), AlignmentConfig())
    assert len(figure.axes) == 3
    legend = figure.axes[2].get_legend()
    assert legend is not None and len(legend.get_texts()) == 2


def test_a_scan_without_points_is_drawn_empty_and_one_without_colours_refused(
    tmp_path: Path,
) -> None:
    with pytest.raises(DataError, match="scan 7"):
        cluster_scan(7, dataclasses.replace(place(1), colors=None), SceneConfig())
    nothing = cluster_scan(0, NOTHING, SceneConfig())
    write_scene_picture(tmp_path / "empty.png", nothing)
    assert not draw_pair(nothing, scan(1), SimilarityConfig(), AlignmentConfig()).artists


def test_without_matplotlib_the_extra_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(FusionSlamError, check=has_code("missing-extra", "report")):
        write_scene_picture(tmp_path / "none.png", scan(1))
    assert not (tmp_path / "none.png").exists()


def test_the_command_draws_scans_of_recordings_and_bags(tmp_path: Path, unrendered: None) -> None:
    write_recording(tmp_path / "r.npz", (1, 2, 1))
    write_bag(tmp_path / "b.bag", bag_drive())
    for data in ("r.npz", "b.bag"):
        target = tmp_path / f"{data}.png"
        shown = succeeds("views", "show", tmp_path / data, "--frame", 0, "-o", target)
        assert last_line(shown) == str(target) and target.is_file()


@pytest.mark.slow
def test_the_command_draws_scans_and_pairs_of_sets(tmp_path: Path) -> None:
    drive((1, 2, 1)).save(tmp_path / "set.npz")

    def width(*options: object) -> int:
        target = tmp_path / "drawn.png"
        succeeds("views", "show", tmp_path / "set.npz", *options, "-o", target)
        with Image.open(target) as picture:
            return picture.width

    assert width("--frame", 0) > 600
    pair = ("--frame", 2, "--against", 0)
    three = width(*pair)
    first = (tmp_path / "drawn.png").read_bytes()
    assert three == width(*pair) and (tmp_path / "drawn.png").read_bytes() == first
    assert three > width(*pair, "--set", "views.method=objects")


def test_the_command_says_what_it_cannot_draw(tmp_path: Path) -> None:
    scenes = drive((1, 2, 1))
    scenes.save(tmp_path / "set.npz")
    scenes.with_scenes(SceneConfig()).without_clouds().save(tmp_path / "small.npz")
    target = ("-o", tmp_path / "p.png")
    line = fails(1, "views", "show", tmp_path / "set.npz", "--frame", 3, *target)
    assert "boxes" in line and "scan 3" in line
    words = ("views", "show", tmp_path / "set.npz", "--frame", 0, "--against", -1, *target)
    assert "scan -1" in fails(1, *words)
    line = fails(1, "views", "show", tmp_path / "small.npz", "--frame", 0, *target)
    assert "boxes" in line and "--only-scenes" in line
    words = ("views", "show", tmp_path / "set.npz", "--frame", 0, "-o", tmp_path / "p.jpeg")
    assert "p.jpeg" in fails(2, *words)
    assert not (tmp_path / "p.png").exists() and SceneSet.load(tmp_path / "set.npz")
