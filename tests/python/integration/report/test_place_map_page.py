# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The page of a map: what it says of a made street, and that it needs no network."""

import json
import re
import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from artefacts import artefact, copy_artefact
from error_codes import has_code
from fusionslam import Cloud, DataError
from fusionslam.base.arrays import Floats
from fusionslam.geometry.se3 import exp
from fusionslam.mapping import DriftModel, Edge, PlaceMap, judge_map
from fusionslam.registration import Refusal
from fusionslam.report.place_maps import read_drives, write_map_page
from fusionslam.report.place_maps.contents import drift_factor, fit_loops
from fusionslam.report.place_maps.figures import draw_cloud, draw_quality, draw_trajectories
from fusionslam.report.place_maps.page import (
    influence_table,
    refused_table,
    state_table,
    weak_table,
)
from map_fixtures import FRAMES, build
from pages import Page
from project import PROJECT
from streets import OPTIONS, RETURN, WAY, frames

pytest.importorskip("gtsam", reason="the library of pose graphs is an extra")
pytest.importorskip("matplotlib", reason="pages are an extra")
pytest.importorskip("jinja2", reason="pages are an extra")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A map of a drive, and of one elsewhere that nothing joins with it."""

    def make(folder: Path) -> None:
        build(folder / "site.fsmap")
        build(folder / "site.fsmap", frames(RETURN, 200, place=13), "elsewhere")

    return copy_artefact(artefact("two-sessions-map", make) / "site.fsmap", tmp_path / "site.fsmap")


def without_view(page: Path) -> Page:
    """The page; its view in three dimensions, a page in itself, left out."""
    text, count = re.subn(
        r'(<script type="application/json" id="view-3d-page">).*?(</script>)',
        r"\1\2",
        page.read_text(),
        flags=re.DOTALL,
    )
    assert count == 1 and not re.search(r"https?://|url\(|@import|src=\"(?!data:image/)", text)
    return Page(text)


def test_the_page_says_what_is_in_the_map(path: Path, tmp_path: Path, unrendered: None) -> None:
    with PlaceMap.open(path, read_only=True) as site:
        truth = {"monday": np.array(WAY)}
        page = write_map_page(tmp_path / "a.html", site, truth, command="made by hand", notes=["x"])
        monday, elsewhere = read_drives(site, truth)
    shown = without_view(page)
    assert shown.open == [] and len(set(shown.ids)) == len(shown.ids)
    assert f"{len(WAY) + len(RETURN)} keyframes of 2 sessions in 2 parts" in shown.text
    assert f"ATE of monday: {monday.error:.2f} m" in shown.text
    assert "made by hand" in shown.text and "few-merges" in shown.text
    pictures = [uri for uri in shown.addresses if uri.startswith("data:image/")]
    assert len(pictures) == 6  # trajectories of both parts, quality, drift, cloud, grid
    assert "positions: deviation" in shown.text and "Loops that change most" in shown.text
    assert elsewhere.error is None
    assert monday.error is not None and monday.odometry_error is not None
    assert monday.error < 0.25 < 1 < monday.odometry_error


def test_weak_places_and_vital_loops_are_listed_and_drawn(path: Path) -> None:
    with PlaceMap.open(path, read_only=True) as site:
        quality, drives = judge_map(site), read_drives(site)
    assert weak_table(quality) is None
    first, second = quality.segments[:2]
    segments = (replace(first, weak=("unsure", "refused")), replace(second, weak=("thick-walls",)))
    weak = replace(quality, segments=segments)
    table = weak_table(weak)
    assert [label for label, _ in table.rows] == [
        f"{each.first} to {each.last}" for each in (first, second)
    ]
    assert [cells[1].text for _, cells in table.rows] == ["unsure, refused", "thick-walls"]
    (most, *_), believed = quality.influences, quality.loops
    labels = [label for label, _ in influence_table(quality).rows]
    assert labels[0] == f"{most.edge.a} and {most.edge.b}" and len(labels) == min(believed, 10)
    for judged, is_weak in ((quality, False), (weak, True)):
        (legend,) = draw_quality(drives, judged, 0).legends
        assert ("weak places" in [each.get_text() for each in legend.get_texts()]) == is_weak


def test_the_view_in_3d_is_inside(path: Path, tmp_path: Path, unrendered: None) -> None:
    with PlaceMap.open(path, read_only=True) as site:
        text = write_map_page(tmp_path / "a.html", site).read_text()
    inner = re.search(r'id="view-3d-page">(.*?)</script>', text, re.DOTALL)
    view = json.loads(inner.group(1))
    assert view.startswith("<!DOCTYPE html>") and "THREE" in view


@pytest.mark.parametrize(
    "name",
    [
        "</script><img src=x> $\\frac{$",
        *(pytest.param(name, marks=pytest.mark.nightly) for name in ("_", "x" * 300)),
    ],
)
def test_names_of_sessions_stay_text(tmp_path: Path, name: str) -> None:
    with PlaceMap.open(tmp_path / "a.fsmap", name, **OPTIONS) as site:
        for frame in FRAMES[:3]:
            site.add(frame)
        page = write_map_page(tmp_path / "a.html", site, {name: np.array(WAY[:3])})
        figure = draw_trajectories(read_drives(site), site.loops, 0)
    shown = without_view(page)
    assert name in shown.text and "x" not in shown.addresses
    (legend,) = figure.legends
    assert legend.get_texts()[0].get_text().strip().startswith(name[:5])


def test_pictures_can_be_taken_out_of_a_page(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unrendered: None
) -> None:
    script = str(PROJECT / "scripts/page_picture.py")
    with PlaceMap.open(path, read_only=True) as site:
        page = write_map_page(tmp_path / "a.html", site)
    for name, kind in (("trajectories-0.png", "PNG"), ("cloud.jpg", "JPEG")):
        out = tmp_path / name
        monkeypatch.setattr("sys.argv", [script, str(page), name, str(out)])
        runpy.run_path(script, run_name="__main__")
        assert Image.open(out).format == kind
    monkeypatch.setattr("sys.argv", [script, str(page), "other.png", str(tmp_path / "b.png")])
    with pytest.raises(SystemExit, match=r"grid\.png"):
        runpy.run_path(script, run_name="__main__")


def test_a_map_is_not_replaced_by_its_page(path: Path) -> None:
    before, same = path.read_bytes(), has_code("output-is-input")
    with PlaceMap.open(path, read_only=True) as site, pytest.raises(DataError, check=same):
        write_map_page(path, site)
    assert path.read_bytes() == before


def test_an_empty_map_has_no_page(tmp_path: Path) -> None:
    with PlaceMap.open(tmp_path / "a.fsmap", "monday") as site:
        with pytest.raises(DataError, check=has_code("empty")):
            write_map_page(tmp_path / "a.html", site)
        assert read_drives(site) == []


def chain(count: int, covariance: Floats) -> list[Edge]:
    """Odometry of steps of a metre ahead."""
    step = exp(np.array([1.0, 0, 0, 0, 0, 0]))
    return [
        Edge(number, "odometry", number, number + 1, step, covariance, "believed")
        for number in range(count)
    ]


def test_loops_are_measured_against_the_drift_model() -> None:
    """With odometry whose stated deviations are four times too small the factor is four."""
    rng = np.random.default_rng(1)
    covariance = DriftModel().covariance(exp(np.array([1.0, 0, 0, 0, 0, 0])))
    tight = np.diag([1e-6] * 6) ** 2
    loops, edges = [], []
    for k in range(200):
        offset = 12 * k
        steps = [
            replace(edge, a=edge.a + offset, b=edge.b + offset) for edge in chain(10, covariance)
        ]
        true = np.eye(4)
        for edge in steps:
            true = true @ edge.pose @ exp(4 * rng.multivariate_normal(np.zeros(6), covariance))
        loops.append(Edge(k, "loop", offset, offset + 10, true, tight, "believed"))
        edges += steps
    fits = fit_loops([*edges, *loops], loops)
    assert [fit.metres for fit in fits] == pytest.approx([10.0] * 200)
    factor = drift_factor(fits)
    assert factor == pytest.approx(4, rel=0.1)
    errors = np.array([fit.error_m for fit in fits]), np.array([fit.promised_m for fit in fits])
    assert np.sqrt((errors[0] ** 2).mean() / (errors[1] ** 2).mean()) > 4
    covariance = np.eye(6)
    edges = [edge for edge in chain(9, covariance) if edge.a != 4]
    loop = Edge(9, "merge", 2, 7, np.eye(4), covariance, "believed")
    assert fit_loops(edges, [loop]) == [] and drift_factor([]) is None


def test_refused_loops_are_listed_with_their_reasons() -> None:
    reason = Refusal("contradicts-odometry", 7.25, "7.25 times farther than allowed")
    right = Edge(0, "loop", 1, 2, np.eye(4), np.eye(6), "believed")
    wrong = Edge(1, "loop", 3, 4, np.eye(4), np.eye(6), "refused", reason)
    table = refused_table([right, wrong])
    assert table is not None and refused_table([right]) is None
    ((label, cells),) = table.rows
    assert label == "3 and 4"
    assert [cell.text for cell in cells] == [reason.code, "7.25", reason.text]
    counts = state_table([right, wrong, wrong])
    assert counts is not None and state_table([]) is None
    assert [(name, cells[0].text, cells[1].text) for name, cells in counts.rows] == [
        ("refused", reason.code, "2"),
        ("believed", "", "1"),
    ]


def test_what_is_above_the_robot_is_left_out() -> None:
    floor = np.random.default_rng(1).uniform(-5, 5, (4000, 3)).astype(np.float32)
    floor[:, 2] = 0
    ceiling = floor + np.float32([0, 0, 3])
    red, blue = np.uint8([[255, 0, 0]]), np.uint8([[0, 0, 255]])
    both = Cloud(
        np.concatenate([floor, ceiling]), np.repeat(np.concatenate([red, blue]), 4000, axis=0)
    )
    figure = draw_cloud(both, np.zeros((1, 3)))
    image = figure.axes[0].images[0].get_array()
    assert image is not None and not (image == blue).all(axis=2).any()
    assert (image == red).all(axis=2).any()
    assert draw_cloud(Cloud(ceiling, None), np.zeros((1, 3))) is None
