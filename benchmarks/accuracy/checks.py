# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Checks this program against the originals' stored output and prints a Markdown table.

python -m benchmarks.accuracy.checks            # needs the folder named by FUSIONSLAM_TEST_DATA
python -m benchmarks.accuracy.checks --write    # and put the table into docs/results/checks.md

Exits with 1 if a check exceeds its bound. What lies in the folder: docs/results/checks.md.
"""

import argparse
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter

import fusionslam
from benchmarks.accuracy.bag_depth import FULL_CIRCLE, SECTOR, depth_agreement
from benchmarks.accuracy.data import data_folder
from benchmarks.accuracy.kitti_pairs import PAGE
from benchmarks.accuracy.markdown import table, write_between
from fusionslam import FusionConfig, PipelineConfig, describe_dataset
from fusionslam.datasets import open_dataset, read_poses_kitti
from fusionslam.evaluation import evaluate, precision_recall
from fusionslam.sim import SimConfig, embedded_folder, record

# Explained in docs/results/checks.md; they count as missed, but do not fail a script.
KNOWN_SHORTFALLS = {"KITTI 00/000000, stereo `image_undistort` within 1 px of the scan, all"}


class Row(NamedTuple):
    """A check: what, its bound, what came out, and whether that is within; None has no bound."""

    what: str
    bound: str
    came: str
    fits: bool | None

    @property
    def verdict(self) -> str:
        if self.fits is False and self.what in KNOWN_SHORTFALLS:
            return "falls short, known"
        return {True: "pass", False: "FAIL", None: ""}[self.fits]


def checks(data: Path) -> Iterator[Row]:
    """One after the other."""
    yield from m2dp_rows(data)
    yield from cm2dp_rows(data)
    yield from normals_rows(data)
    yield from evaluation_rows(data)
    yield from curve_rows(data)
    yield from fusion_rows(data)
    yield from matching_rows(data)
    yield from stereo_rows(data)
    yield from invariance_rows(data)
    yield from bag_rows(data)
    yield from town_rows()


def scan(path: Path) -> np.ndarray:
    return np.fromfile(path, np.float32).reshape(-1, 4)[:, :3]


def m2dp_rows(data: Path) -> Iterator[Row]:
    points = scan(data / "kitti/sequences/00/velodyne/000000.bin")
    signature = np.load(data / "reference/m2dp/kitti00_000000_signature_64x128.npy")
    descriptor = np.load(data / "reference/m2dp/kitti00_000000_descriptor_192.npy")
    for preset in ("paper", "author"):
        ours = fusionslam.m2dp_signature(points, preset=preset)
        change = np.rint((ours - signature) * len(points))
        moved, missing = change[change > 0].sum(), abs(change.sum())
        votes = f"{moved:.0f} moved, {missing:.0f} left out"
        what = f"M2DP `{preset}`, votes that differ from He's signature"
        yield Row(what, "64", votes, max(moved, missing) <= 64)
        vector = fusionslam.m2dp(points, preset=preset)
        distance = min(np.linalg.norm(vector - descriptor), np.linalg.norm(vector + descriptor))
        yield largest(f"M2DP `{preset}`, L2 to He's descriptor up to sign", distance)


def largest(what: str, value: float | np.floating[Any], bound: float = 1e-4) -> Row:
    """A value that must not exceed its bound."""
    exponent = int(np.floor(np.log10(bound)))
    return Row(what, f"1e{exponent}", f"{value:.1e}", bool(value <= bound))


def equal(what: str, wanted: str, came: str) -> Row:
    """A text that must be the one wanted."""
    return Row(what, wanted, came, wanted == came)


def colored_cloud(data: Path) -> tuple[np.ndarray, np.ndarray]:
    cloud = np.load(data / "reference/cm2dp/colored_cloud.npz")
    return cloud["xyz"], cloud["rgb"]


def cm2dp_rows(data: Path) -> Iterator[Row]:
    points, colors = colored_cloud(data)
    vectors = {"m2dp_192": fusionslam.m2dp(points, preset="author")}
    for space in ("rgb", "hsv", "lab"):
        vectors[f"cm2dp_{space}_576"] = fusionslam.cm2dp(
            points, colors, color_space=space, preset="author"
        )
    vectors["shot_352"] = fusionslam.shot(points)
    vectors["cshot_1344"] = fusionslam.cshot(points, colors)
    for name, vector in vectors.items():
        distance = np.linalg.norm(vector - np.load(data / f"reference/cm2dp/{name}.npy"))
        yield largest(f"L2 to the c-M2DP author's `{name}`", distance)


def normals_rows(data: Path) -> Iterator[Row]:
    points, _ = colored_cloud(data)
    stored = np.load(data / "reference/cm2dp/normals.npz")["normals"][:, 3:6]
    normals, _, _ = fusionslam.estimate_normals(points, radius=0.323908135)
    error = np.minimum(np.abs(normals - stored), np.abs(normals + stored)).max()
    yield largest(f"{len(normals):,} normals, largest difference up to sign", error)


def evaluation_rows(data: Path) -> Iterator[Row]:
    descriptors = np.load(data / "descriptors/kitti06_lidar_camera_m2dp.npy")
    positions = read_poses_kitti(data / "kitti/poses/06.txt")[:, :3, 3]
    expected = {
        "perdomo2019": {"recall_at_full_precision": "0.668122"},
        "revisit": {
            "n_revisits": "274",
            "top1": "0.836",
            "recall_at_full_precision": "0.558",
            "max_f1": "0.790",
            "average_precision": "0.787",
        },
    }
    for protocol, figures in expected.items():
        curve = precision_recall(descriptors, positions, protocol=protocol)
        for name, wanted in figures.items():
            digits = len(wanted.partition(".")[2])
            value = f"{getattr(curve, name):.{digits}f}"
            yield equal(f"KITTI 06 stored M2DP, `{protocol}`, {name}", wanted, value)


def curve_rows(data: Path) -> Iterator[Row]:
    descriptors = np.load(data / "descriptors/kitti06_lidar_camera_m2dp.npy")
    positions = read_poses_kitti(data / "kitti/poses/06.txt")[:, :3, 3]
    stored = np.loadtxt(
        data / "descriptors/kitti06_lidar_camera_m2dp.pr.csv", delimiter=",", skiprows=1
    )
    curve = precision_recall(descriptors, positions, protocol="perdomo2019")
    ours = np.c_[curve.recall, curve.precision]
    same = (np.abs(ours - stored) <= 5e-6 * stored).all(axis=1).sum()
    yield equal("rows of the stored curve of KITTI 06, to 6 digits", f"{len(stored)}", f"{same}")


def fusion_rows(data: Path) -> Iterator[Row]:
    for name, folder in (("raw", "kitti/raw_2011_09_26"), ("object", "kitti/object/training")):
        frame = open_dataset(data / folder)[0]
        image, matrix = frame.images["left"], frame.cameras["left"].projection_from_points
        assert frame.points is not None
        _, colors, kept = fusionslam.colorize(frame.points, image, matrix)
        u, v, w = matrix @ np.c_[frame.points.astype(np.float64), np.ones(len(frame.points))].T
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels = np.floor(np.c_[v / w, u / w] + 0.5)
        inside = (w > 0) & (pixels >= 0).all(axis=1) & (pixels < image.shape[:2]).all(axis=1)
        rows, columns = pixels[inside].astype(int).T
        differ = len(set(kept.tolist()) ^ set(np.flatnonzero(inside).tolist()))
        if differ == 0:
            differ = int((colors != image[rows, columns]).any(axis=1).sum())
        came = f"{differ} of {inside.sum():,}"
        yield Row(f"KITTI {name}, points coloured otherwise than by NumPy", "0", came, differ == 0)


def matching_rows(data: Path) -> Iterator[Row]:
    rows = np.load(data / "descriptors/kitti06_lidar_camera_m2dp.npy")
    found, _ = fusionslam.nearest_causal(rows, window=50, k=5)
    wide = rows.astype(np.float64)
    differ = 0
    for i in range(51, len(rows)):
        order = np.argsort(((wide[: i - 50] - wide[i]) ** 2).sum(axis=1), kind="stable")[:5]
        differ += int((found[i, : len(order)] != order).sum())
    yield equal(
        "5 nearest of KITTI 06's 1101 descriptors that differ from NumPy's", "0", f"{differ}"
    )
    points, colors = colored_cloud(data)
    calls: dict[str, Callable[[int], NDArray[np.float32]]] = {
        "m2dp": lambda threads: fusionslam.m2dp(points, threads=threads),
        "cm2dp": lambda threads: fusionslam.cm2dp(points, colors, threads=threads),
        "shot": lambda threads: fusionslam.shot(points, threads=threads),
        "cshot": lambda threads: fusionslam.cshot(points, colors, threads=threads),
    }
    for name, call in calls.items():
        same = len({call(threads).tobytes() for threads in (1, 1, 2)}) == 1
        came = "identical" if same else "differ"
        yield equal(f"{name}, two runs and two threads", "identical", came)


def bag_rows(data: Path) -> Iterator[Row]:
    full = depth_agreement(data, FULL_CIRCLE)
    what = "bag, fused points within 3 cm of the depth rendered from the same world"
    yield Row(f"{what}, full circle", "90 %", f"{full.share:.1%}", full.share >= 0.9)
    sector = depth_agreement(data, SECTOR)
    yield Row(f"{what}, sector on collision shapes", "", f"{sector.share:.1%}", None)


def town_rows() -> Iterator[Row]:
    """Scan Context of the embedded drive's full circles beside the figures of a separate program.

    That was written from the paper alone, in Python.
    """
    dataset = open_dataset(record(SimConfig(), embedded_folder()))
    config = PipelineConfig(fusion=FusionConfig(source="cloud"))
    with tempfile.TemporaryDirectory() as folder:
        (run,) = describe_dataset(dataset, ["scan_context"], folder, config=config)
    curve = evaluate(run, protocols=["revisit"]).curves["revisit"]
    assert curve.top1 is not None and curve.recall_at_full_precision is not None
    for what, found, expected in (
        ("top-1", curve.top1, 0.625),
        ("recall at 100 % precision", curve.recall_at_full_precision, 0.310),
    ):
        fits = bool(abs(found - expected) <= 0.02)
        what = f"embedded drive, full circle, Scan Context, {what}"
        yield Row(what, f"{expected:.3f} within 0.02", f"{found:.3f}", fits)


def stereo_rows(data: Path) -> Iterator[Row]:
    dataset = open_dataset(data / "kitti/sequences/00", gaps="skip")
    frame = dataset[0]
    assert frame.points is not None
    left, right = frame.images["left"], frame.images["right"]
    height, width = left.shape[:2]
    matrices = [
        frame.cameras[name].projection @ frame.cameras["left"].rectified_from_points
        for name in ("left", "right")
    ]
    u, v, predicted, visible = lidar_disparity(frame.points, matrices, width, height)
    for preset in ("image_undistort", "sgbm"):
        config = fusionslam.StereoConfig(preset=preset)
        found = fusionslam.stereo_disparity(left, right, config=config)[v, u]
        for who, mask in (("all", found > 0), ("those the camera sees", (found > 0) & visible)):
            share = (np.abs(found - predicted)[mask] <= 1).mean()
            what = f"KITTI 00/000000, stereo `{preset}` within 1 px of the scan, {who}"
            yield Row(what, ">= 70 %", f"{share:.1%} of {mask.sum():,} points", bool(share >= 0.7))


def lidar_disparity(
    points: np.ndarray, matrices: list[np.ndarray], width: int, height: int
) -> tuple[np.ndarray, ...]:
    """Pixel (u, v), disparity and visibility of the scan's points in the left image.

    The scanner looks over what hides things from the camera: a point counts as visible unless
    another one within 4 x 7 pixels is clearly nearer.
    """
    homogeneous = np.c_[points.astype(np.float64), np.ones(len(points))]
    (ul, vl, wl), (ur, _, wr) = (matrix @ homogeneous.T for matrix in matrices)
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v, predicted = np.rint(ul / wl), np.rint(vl / wl), ul / wl - ur / wr
    seen = (wl > 0) & (u >= 0) & (u < width) & (v >= 0) & (v < height)
    u, v, predicted = u[seen].astype(int), v[seen].astype(int), predicted[seen]
    depth = fusionslam.depth_image(points, matrices[0], width=width, height=height)
    nearest = minimum_filter(np.where(depth > 0, depth, np.inf), size=(15, 9))[v, u]
    return u, v, predicted, wl[seen] < 1.05 * nearest + 0.3


def invariance_rows(data: Path) -> Iterator[Row]:
    paths = sorted((data / "kitti/sequences").glob("0*/velodyne/*.bin"))
    scans = [scan(path) for path in paths]
    for preset in ("author", "robust"):
        rng = np.random.default_rng(0)
        plain = [fusionslam.m2dp(points, preset=preset) for points in scans]
        moved, dropped = [], []
        for points, vector in zip(scans, plain, strict=True):
            rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))  # determinant 1 or -1: mirrors too
            turned = (points @ rotation.T + rng.uniform(-50, 50, 3)).astype(np.float32)
            moved.append(np.linalg.norm(fusionslam.m2dp(turned, preset=preset) - vector))
            kept = points[rng.random(len(points)) > 0.1]
            dropped.append(np.linalg.norm(fusionslam.m2dp(kept, preset=preset) - vector))
        others = min(np.linalg.norm(a - b) for i, a in enumerate(plain) for b in plain[:i])
        what = f"M2DP `{preset}`, {len(scans)} scans of 00 and 08"
        turned = f"{what}, turned, shifted, mirrored: largest L2"
        if preset == "robust":
            yield largest(turned, max(moved))
        else:
            yield Row(turned, "for comparison", f"{max(moved):.1e}", None)
        yield Row(
            f"{what}, 10 % of points dropped: largest L2",
            f"< {others:.3f}",
            f"{max(dropped):.3f}",
            bool(max(dropped) < others),
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true")
    arguments = parser.parse_args()
    rows = list(checks(data_folder()))
    text = table(["check", "bound", "result", ""], [[*row[:3], row.verdict] for row in rows])
    print(text)
    if arguments.write:
        write_between(PAGE, "checks", text)
    passed = sum(row.verdict == "pass" for row in rows)
    print(f"{passed} of {sum(row.fits is not None for row in rows)} checks passed")
    sys.exit(any(row.verdict == "FAIL" for row in rows))


if __name__ == "__main__":
    main()
