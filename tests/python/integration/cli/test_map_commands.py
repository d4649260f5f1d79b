# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The commands map build, show, localize, export and check on a made street."""

import json
import re
import shutil
import sqlite3
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from artefacts import artefact, copy_artefact
from cli import error_of, refusal, run, settings, succeeds, table
from fusionslam import Cloud, DataError, FusionConfig, PlaceMap, datasets
from fusionslam.cli.map_building import describe_growth
from fusionslam.datasets.cloud_files import write_cloud
from fusionslam.pipelines.odometry_check import warn_of_wrong_odometry
from fusionslam.pipelines.place_maps import Built, odometry_of
from fusionslam.pipelines.recording import FrameError
from rows import rows
from streets import RETURN, WAY, error, write_street

pytest.importorskip("gtsam", reason="the library of pose graphs is an extra")
pytest.importorskip("matplotlib", reason="map build writes a page")

OPTIONS = ("-d", "m2dp", "--set", "loop_closure.window=3")
NO_PAGE = (*OPTIONS, "--no-report")


def write_map(folder: Path) -> None:
    """A street, the map of it, and the same street driven back the next day."""
    write_street(folder / "street", WAY)
    write_street(folder / "return", RETURN, 200)
    succeeds("map", "build", folder / "street", "-o", folder / "site.fsmap", *OPTIONS)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    # SQLite may write beside a map that is only read.
    return copy_artefact(artefact("cli-map", write_map), tmp_path_factory.mktemp("map") / "made")


@pytest.fixture(scope="module")
def street(made: Path) -> Path:
    return made / "street"


@pytest.fixture(scope="module")
def built(made: Path) -> Path:
    return made / "site.fsmap"


@pytest.fixture
def site(built: Path, tmp_path: Path) -> Path:
    return Path(shutil.copy(built, tmp_path / "site.fsmap"))


def test_a_recording_becomes_a_map(built: Path) -> None:
    with PlaceMap.open(built, read_only=True) as site:
        assert [each.name for each in site.sessions] == ["street"]
        assert error(site.trajectory("street")[1], WAY) < 0.25 < error(site.odometry("street"), WAY)


def test_scans_with_colours_are_found_on_a_map_that_a_camera_coloured(
    street: Path, tmp_path: Path
) -> None:
    plain = datasets.open_dataset(street).only(range(2))
    for frame in plain:
        grey = np.full((len(frame.points), 3), 99, np.uint8)
        write_cloud(tmp_path / f"rgbd/clouds/{frame.number}.ply", Cloud(frame.points, grey))
        write_cloud(tmp_path / f"plain/clouds/{frame.number}.ply", Cloud(frame.points))
    path, output = tmp_path / "site.fsmap", tmp_path / "found.csv"
    with PlaceMap.open(path, "monday", descriptor="m2dp", fusion=FusionConfig()) as site:
        for frame, moved in zip(datasets.open_dataset(tmp_path / "rgbd"), WAY, strict=False):
            site.add(frame, odometry=moved)
    words = ("--map", path, "-o", output)
    assert "2 of 2 frames" in succeeds("map", "localize", tmp_path / "rgbd", *words).stdout
    assert error_of(1, "map", "localize", tmp_path / "plain", *words).code == "missing-sensor"


def in_millimetres(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    scaled = poses.copy()
    scaled[:, :3, 3] *= 1000
    return scaled


@rows("change, word", [(np.array, ""), (np.linalg.inv, "inverse"), (in_millimetres, "millimetres")])
def test_odometry_that_is_inverse_or_in_millimetres_is_told(
    street: Path,
    change: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    word: str,
    caplog: pytest.LogCaptureFixture,
) -> None:
    data = datasets.open_dataset(street)
    odometry = odometry_of(data, "recorded")
    assert odometry is not None
    warn_of_wrong_odometry(data, change(odometry))
    assert [word in each for each in caplog.messages] == [True] * bool(word)


@rows(
    "keyframes, loops, window, told",
    [(29, 0, 20, 7), (29, 1, 20, 0), (41, 0, 20, 0), (3, 0, 20, 0)],
)
def test_a_window_that_leaves_little_to_compare_is_told(
    keyframes: int, loops: int, window: int, told: int
) -> None:
    said = describe_growth(Built(200, keyframes, loops, {}), window)
    assert (f"loop_closure.window={told}" in said) == bool(told) == ("window" in said)


def test_a_page_beside_the_map_shows_it(built: Path) -> None:
    page = built.with_suffix(".html").read_text()
    assert f"{len(WAY)} keyframes of 1 session" in page and "fusionslam" in page


@pytest.mark.slow
def test_the_page_repeats_what_is_wrong_with_the_map(street: Path, tmp_path: Path) -> None:
    names = ("m", "height", "heading", "tilt", "turn")
    tight = settings(*(f"mapping.drift.drift_{name}=0.0002" for name in names))
    path = tmp_path / "site.fsmap"
    succeeds("map", "build", street, "-o", path, *OPTIONS, *tight)
    with PlaceMap.open(path) as site:
        site.solve()
        assert site.reason is not None and site.reason.code == "overconfident-odometry"
        assert str(site.reason) in path.with_suffix(".html").read_text()


@pytest.mark.slow
def test_errors_are_printed_where_the_truth_is_known(street: Path, tmp_path: Path) -> None:
    truth = tmp_path / "truth.txt"
    stamps = (np.loadtxt(street / "times.txt") * 1e9).astype(np.int64)
    datasets.write_poses_tum(truth, stamps, np.array(WAY))
    path = tmp_path / "site.fsmap"
    words = ("map", "build", street, "-o", path, "--gt", truth, *NO_PAGE)
    lines = succeeds(*words).stdout.splitlines()
    (found,) = [line for line in lines if line.startswith("ATE of street")]
    errors = [float(word) for word in found.replace(":", "").split() if word[0].isdigit()]
    with PlaceMap.open(path, read_only=True) as site:
        known = error(site.trajectory("street")[1], WAY), error(site.odometry("street"), WAY)
    assert errors == pytest.approx(known, abs=0.006)
    assert "kB a keyframe" in lines[2] and not path.with_suffix(".html").exists()


@pytest.mark.slow
def test_building_goes_on_where_it_ended(street: Path, built: Path, tmp_path: Path) -> None:
    half = copy_artefact(street, tmp_path / "street")
    for scan in sorted((half / "clouds").iterdir())[9:]:
        scan.unlink()
    times = (half / "times.txt").read_text().splitlines()
    (half / "times.txt").write_text("\n".join(times[:9]) + "\n")
    path = tmp_path / "site.fsmap"
    succeeds("map", "build", half, "-o", path, *NO_PAGE)
    succeeds("map", "build", street, "-o", path, "--no-report")
    with PlaceMap.open(path, read_only=True) as one, PlaceMap.open(built, read_only=True) as two:
        np.testing.assert_array_equal(one.trajectory("street")[1], two.trajectory("street")[1])
    before = path.read_bytes()
    again = succeeds("map", "build", street, "-o", path, "--no-report").stdout
    assert path.read_bytes() == before
    assert again.startswith("street: nothing new")


@pytest.mark.slow
def test_a_session_is_of_one_recording(made: Path, site: Path) -> None:
    words = ("map", "build", made / "return", "-o", site, "--session")
    assert error_of(2, *words, "street").code == "other-recording"
    succeeds(*words, "tuesday", "--no-report")
    with PlaceMap.open(site, read_only=True) as grown:
        assert [each.parts for each in grown.sessions] == [(0,), (0,)]


def test_frames_are_found_on_a_map(made: Path, built: Path, tmp_path: Path) -> None:
    output = tmp_path / "found.csv"
    said = succeeds("map", "localize", made / "return", "--map", built, "-o", output).stdout
    found = table(output)
    other = ("--set", "fusion.voxel=0.7")
    again = error_of(2, "map", "localize", made / "return", "--map", built, "-o", output, *other)
    assert (again.code, again.fields) == ("other-config", ("fusion.voxel",))
    assert sum(map(int, re.findall(r"(\d+) (?:of|not)", said))) == len(found)  # reasons are counted
    assert len(found) == len(RETURN)
    for code, count in Counter(row["reason"] for row in found if row["reason"]).items():
        assert f"; {count} not: {code}" in said
    known = [row for row in found if not row["reason"]]
    assert len(known) >= 7
    for row in known:
        truth = np.linalg.inv(WAY[0]) @ RETURN[int(row["frame"])]
        place = [float(row[axis]) for axis in "xyz"]
        assert np.linalg.norm(place - truth[:3, 3]) < 0.6
        assert row["keyframe"] and row["part"] == "0"


def test_a_map_is_exported(built: Path, tmp_path: Path) -> None:
    pyproj = pytest.importorskip("pyproj")
    words = ("map", "export", built, "-o", tmp_path, "--resolution", "0.5", "--voxel", "0.5")
    succeeds(*words, "--origin", "49,8.4,110,30", "--covariance")
    found = {path.name for path in tmp_path.iterdir()}
    grid = {"grid.pgm", "grid.yaml", "heights.asc"}
    others = {"cloud.ply", "cloud.pcd", "graph.g2o", "trajectory.geojson"}
    others |= {f"street.{kind}" for kind in ("tum", "kitti", "csv")}
    assert found == others | grid
    assert yaml.safe_load((tmp_path / "grid.yaml").read_text())["resolution"] == 0.5
    _, poses = datasets.read_poses(tmp_path / "street.tum")
    np.testing.assert_allclose(datasets.read_poses(tmp_path / "street.kitti")[1], poses, atol=1e-12)
    told = table(tmp_path / "street.csv")
    assert len(told) == len(poses) == len(WAY)
    last = np.array([float(told[-1][f"cov_{axis}_{axis}"]) for axis in ("x", "y", "z", "rx")])
    assert ((last > 0.001**2) & (last < 0.2**2)).all()
    clouds = [datasets.read_cloud(tmp_path / f"cloud.{kind}").points for kind in ("ply", "pcd")]
    np.testing.assert_allclose(*clouds)
    utm = tmp_path / "utm"
    again = ("map", "export", built, "-o", utm, "--voxel", "1", "--resolution", "1")
    assert error_of(1, *again, "--frame", "utm").code == "no-origin"
    succeeds(*again, "--frame", "utm", "--origin", "49,8.4,110,30")
    _, placed = datasets.read_poses(utm / "street.epsg32632.tum")
    (line,) = json.loads((tmp_path / "trajectory.geojson").read_text())["features"]
    longitude, latitude, height = np.array(line["geometry"]["coordinates"]).T
    east, north = pyproj.Transformer.from_crs(4979, 32632).transform(latitude, longitude)[:2]
    np.testing.assert_allclose(placed[:, :3, 3], np.stack([east, north, height], 1), atol=2e-3)
    for origin in ("49", "north,east", "100,0", "1,2,3,4,5"):
        problem = error_of(2, "map", "export", built, "-o", tmp_path / "other", "--origin", origin)
        assert "origin" in str(problem)


@pytest.mark.slow
def test_a_map_is_shown_and_described(built: Path, tmp_path: Path) -> None:
    page = tmp_path / "map.html"
    shown = succeeds("map", "show", built, "-o", page).stdout
    assert f"street: {len(WAY)} keyframes" in shown
    assert "believed" in page.read_text()
    described = succeeds("info", built).stdout
    assert "session street" in described and f"{len(WAY)} keyframes" in described


def test_an_empty_map_is_described(tmp_path: Path) -> None:
    with PlaceMap.open(tmp_path / "a.fsmap", "monday"):
        pass
    described = succeeds("info", tmp_path / "a.fsmap").stdout
    assert "map, by map build" in described and "none yet" in described


def test_a_map_is_corrected_by_hand(site: Path) -> None:
    wrong = ("map", "link", site, 2, 8, "--pose", "-1,0,0,90")
    refused = run(*wrong)
    assert refused.exit_code == 1 and "refused" in refused.stdout
    assert "forced by hand" in succeeds(*wrong, "--force", "--why", "gate 3").stdout
    assert "forced by hand" in succeeds("map", "fix", site, 1, "-0.01,0,0,0,0,0", "--force").stdout
    assert "1 loop taken out" in succeeds("map", "unlink", site, 2, 8).stdout
    assert "unlink 2 8" in succeeds("map", "undo", site).stdout
    shown = succeeds("map", "show", site).stdout.splitlines()
    actions = [line.split(",")[0] for line in shown if re.match(r"\d+: ", line)]
    assert actions == ["1: link 2 8", "2: fix 0 1", "3: unlink 2 8", "4: undo of 3"]
    assert any(line.endswith("gate 3") for line in shown)
    assert refusal(2, "map", "fix", site, 1, "1,2,3") == ("choice", "POSE", "1,2,3")
    assert refusal(1, "map", "link", site, 1, 1)[0] == "same-keyframe"


def test_a_damaged_map_is_found(site: Path) -> None:
    succeeds("map", "check", site)
    data = bytearray(site.read_bytes())
    middle = len(data) // 2 // 65536 * 65536
    data[middle : middle + 60_000] = bytes(60_000)
    site.write_bytes(data)
    assert run("map", "check", site).exit_code == 1


def test_data_without_odometry_say_how_to_get_it(street: Path, tmp_path: Path) -> None:
    bare = copy_artefact(street, tmp_path / "bare")
    (bare / "odometry.txt").unlink()
    words = ("map", "build", bare, "-o", tmp_path / "a.fsmap")
    problem = error_of(1, *words)
    assert problem.code == "no-odometry" and "--odometry lidar" in str(problem)
    assert error_of(1, *words, "--odometry", "truth+noise").code == "no-poses"
    assert [*tmp_path.iterdir()] == [bare]  # no empty maps


def test_a_frame_is_not_blamed_for_a_full_disk(
    street: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    full = DataError("cannot write a.fsmap: the disk is full", code="cannot-write")

    def add(*_: object, **__: object) -> None:
        raise full

    monkeypatch.setattr(PlaceMap, "add", add)
    words = ("map", "build", street, "-o", tmp_path / "a.fsmap", *OPTIONS, "--skip-bad-frames")
    assert error_of(1, *words) is full
    assert [*tmp_path.iterdir()] == []  # a map that an error left without keyframes


def test_a_new_map_of_clouds_without_colours_is_one_of_m2dp(street: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.fsmap"
    few = ("--set", "mapping.keyframe_distance=9")
    every = tmp_path / "every.tum"
    succeeds("map", "build", street, "-o", path, "--no-report", "--trajectory", every, *few)
    stamps, poses = datasets.read_poses(every)
    with PlaceMap.open(path, read_only=True) as site:
        assert site.settings.descriptor == "m2dp" and len(site) < len(WAY)
        known, keyframes = site.trajectory("street")
        np.testing.assert_allclose(poses[np.isin(stamps, known)], keyframes, atol=1e-6)
    assert len(poses) == len(WAY)
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    assert (steps < 8).all()  # of 6 m, by odometry that is a little too long


def test_what_is_no_map_is_refused(street: Path, tmp_path: Path) -> None:
    problem = error_of(2, "map", "build", street, "-o", tmp_path / "site.html")
    assert problem.fields[0] == "--output" and not [*tmp_path.iterdir()]
    other = tmp_path / "poses.txt"
    shutil.copy(street / "odometry.txt", other)
    for command in ("show", "check", "export"):
        assert error_of(1, "map", command, other).code == "other-format"
        assert error_of(1, "map", command, tmp_path / "none.fsmap").code == "not-found"


@pytest.mark.nightly
def test_two_maps_are_merged(made: Path, site: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.fsmap"
    succeeds("map", "build", made / "return", "--session", "tuesday", "-o", other, *NO_PAGE)
    merged = succeeds("map", "merge", site, other).stdout
    assert "tuesday: 9 keyframes" in merged and "in 1 part" in merged
    elsewhere = write_street(tmp_path / "elsewhere", RETURN, 200, place=13)
    third = tmp_path / "third.fsmap"
    succeeds("map", "build", elsewhere, "-o", third, *NO_PAGE)
    before = site.read_bytes()
    assert run("map", "merge", site, third).exit_code == 1
    assert site.read_bytes() == before
    alone = succeeds("map", "forget", site, "tuesday").stdout
    assert "tuesday" not in alone and "street: 18 keyframes" in alone
    assert error_of(2, "map", "forget", site, "tuesday").code


@pytest.mark.slow
def test_sessions_of_similar_names_have_different_files(site: Path, tmp_path: Path) -> None:
    short = write_street(tmp_path / "short", WAY[:3])
    for name in ("a/b", "a_b"):
        succeeds("map", "build", short, "-o", site, "--session", name, "--no-report")
    lines = succeeds("map", "export", site, "-o", tmp_path / "out").stdout.splitlines()
    said = dict(line.split(": session ") for line in lines if ".tum" in line)
    folder = tmp_path / "out"
    files = {"street": "street.tum", "a_b": "a_b.tum", "a/b": "a_b-2.tum"}
    assert said == {str(folder / file): name for name, file in files.items()}
    with PlaceMap.open(site, read_only=True) as grown:
        for name, file in files.items():
            stamps, _ = datasets.read_poses_tum(folder / file)
            np.testing.assert_allclose(stamps, grown.trajectory(name)[0])


@rows("skip", [(), ("--skip-bad-frames",)])
def test_a_damaged_map_is_no_fault_of_a_frame(
    street: Path, site: Path, tmp_path: Path, skip: tuple[str, ...]
) -> None:
    with closing(sqlite3.connect(site)) as database:
        database.execute("UPDATE cloud SET crc = crc + 1")
        database.commit()
    words = ("map", "localize", street, "--map", site, "-o", tmp_path / "found.csv", *skip)
    problem = error_of(1, *words)
    assert (problem.code, problem.fields) == ("damaged", (str(site),))
    assert not isinstance(problem, FrameError) and not (tmp_path / "found.csv").exists()


def test_a_map_is_no_recording(site: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.fsmap"
    cut.write_bytes(site.read_bytes()[:200_000])
    unnamed = Path(shutil.copy(site, tmp_path / "site.db"))
    for path in (site, cut, unnamed):
        for words in (("loops",), ("fuse",), ("map", "build"), ("map", "localize", "--map", site)):
            assert refusal(1, *words, path, "-o", tmp_path / "out") == ("is-map", str(path))
    assert error_of(1, "info", cut).code == "is-map"


def test_no_map_or_recording_is_replaced(street: Path, site: Path, tmp_path: Path) -> None:
    bag, truth = tmp_path / "drive.bag", tmp_path / "truth.txt"
    bag.write_bytes(b"#ROSBAG V2.0\n")
    shutil.copy(street / "odometry.txt", truth)
    localize = ("map", "localize", street, "--map", site, "--gt", truth, "-o")
    own, other = "output-is-input", "output-is-data"
    assert error_of(1, *localize, site).code == own
    assert error_of(1, *localize, truth).code == own
    assert error_of(1, *localize, bag).code == other
    assert error_of(1, "map", "show", site, "-o", bag).code == other
    assert error_of(1, "map", "show", site, "-o", site).code == own
    assert error_of(1, "map", "build", street, "-o", bag).code == other
    for command in ("localize", "build"):
        assert error_of(1, "map", command, bag, "-o", bag).code == own
    link = site.with_name("link.fsmap")
    link.symlink_to(site)
    for itself in (site, link):
        assert error_of(2, "map", "merge", site, itself).code == "same-file"
    assert bag.read_bytes() == b"#ROSBAG V2.0\n"
    assert truth.read_bytes() == (street / "odometry.txt").read_bytes()
