# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Every instruction set that this machine has gives the same bytes."""

import os
import subprocess
import sys

import pytest

# Runs in a process of its own, because the level is chosen once a process.
PROGRAM = """
import hashlib
import numpy as np
import fusionslam
import fusionslam.ratslam
import fusionslam.registration

random = np.random.default_rng(4)
points = (random.normal(size=(3001, 3)) * [9, 4, 1] + [3, -2, 1]).astype(np.float32)
colors = random.integers(0, 256, points.shape, dtype=np.uint8)
image = random.integers(0, 256, (60, 80, 3), dtype=np.uint8)
projection = np.array([[50, 0, 40, 0], [0, 50, 30, 0], [0, 0, 1, 9]], float)
table = np.abs(random.normal(size=(400, 192))).astype(np.float32)

results = {}
for preset in ("paper", "author", "robust", "upright"):
    results["m2dp " + preset] = fusionslam.m2dp(points, preset=preset)
    for space in ("rgb", "hsv", "lab"):
        results[f"cm2dp {preset} {space}"] = fusionslam.cm2dp(
            points, colors, preset=preset, color_space=space
        )
results["signature"] = fusionslam.cm2dp_signature(points, colors)
results["singular vectors"] = fusionslam.first_singular_vectors(table)
results["normals"] = fusionslam.estimate_normals(points, radius=1.0)
results["resolution"] = fusionslam.cloud_resolution(points)
results["shot"] = fusionslam.shot(points)
results["cshot"] = fusionslam.cshot(points, colors)
results["cscan_context"] = fusionslam.cscan_context(points, colors)
results["bev_spectrum"] = fusionslam.bev_spectrum(points)
intensities = random.uniform(0, 1, len(points)).astype(np.float32)
results["intensity_scan_context"] = fusionslam.intensity_scan_context(points, intensities)
for name in "scan_context_cartesian iris solid_parts ring ndt_histogram".split():
    results[name] = getattr(fusionslam, name)(points)
results["vfh"] = fusionslam.vfh(points)
regions = {"min_points": 3, "max_curvature": 0.1, "max_angle": 0.5}
results["cvfh"] = fusionslam.cvfh(points, config=fusionslam.CvfhConfig(**regions))
results["our_cvfh"] = fusionslam.our_cvfh(points, config=fusionslam.OurCvfhConfig(**regions))
results["esf"] = fusionslam.esf(points)
results["gasd_color"] = fusionslam.gasd_color(points, colors)
results["gestalt"] = fusionslam.gestalt(points)
results["gfh"] = fusionslam.gfh(points)
results["cospair"] = fusionslam.cospair(points, colors)
results["colorize"] = fusionslam.colorize(points, image, projection)
results["bilinear"] = fusionslam.colorize(points, image, projection, interpolation="bilinear")
pair = [image, image[::-1].copy()], [projection, projection @ np.diag([1.0, 1, -1, 1])]
results["all round"] = fusionslam.colorize_all_round(points, *pair)
results["depth"] = fusionslam.depth_image(points, projection, width=80, height=60)
results["nearest"] = fusionslam.nearest_causal(table, window=5, k=3)
contexts = random.uniform(0, 5, (30, 1200)).astype(np.float32)
results["nearest contexts"] = fusionslam.nearest(contexts, contexts, k=30, metric="scan_context")
index = fusionslam.DescriptorIndex(192)
for row in table:
    index.add(row)
results["query"] = index.query(table[7] + np.float32(0.01), k=9)
moved = points + np.float32([0.1, 0, 0])
scenes = [fusionslam.views.build_scene(cloud, colors) for cloud in (points, moved)]
results["scene"] = scenes[1].to_bytes()
aligned = fusionslam.views.align_scenes(*scenes)
results["alignment"] = [aligned.x, aligned.y, aligned.yaw, *aligned.evidence.values()]
for preset in ("openratslam", "robust"):
    cells = fusionslam.ratslam.PoseCells(preset=preset)
    for step in range(60):
        cells.on_view(step % 20, 0.01 * step)
        cells.on_odometry(0.5, 0.2, 0.3)
    results["pose cells " + preset] = cells.activity, cells.best
turned = np.array([[0, -1, 0, 2], [1, 0, 0, -1], [0, 0, 1, 0.5], [0, 0, 0, 1]], float)
ranges = fusionslam.registration.nearest_ranges(points)
counts = fusionslam.registration.count_overlap(points, moved, ranges, turned)
assert min(counts.values()) > 0, counts
results["overlap"] = ranges, [*counts.values()]
surfaces = [fusionslam._core.SurfaceCloud(cloud) for cloud in (points, moved)]
refined = fusionslam._core.refine_pose(*surfaces, np.eye(4), distance=2.0)
results["refinement"] = refined.target_from_source, refined.information, refined.error
for name, value in results.items():
    parts = value if isinstance(value, (tuple, list)) else (value,)
    digest = hashlib.sha256(b"".join(np.asarray(part).tobytes() for part in parts))
    print(name, digest.hexdigest())
print("level", fusionslam.simd_level())
"""


def run_on(level: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env={**os.environ, "FUSIONSLAM_SIMD": level},
        capture_output=True,
        text=True,
    )


@pytest.mark.slow
def test_results_of_every_level_are_those_of_the_baseline_bit_for_bit() -> None:
    digests = {}
    for level in ("baseline", "avx2", "avx512"):
        done = run_on(level)
        if "this machine has no more than" in done.stderr:
            break
        assert done.returncode == 0, done.stderr
        *digests[level], used = done.stdout.splitlines()
        assert used == f"level {level}"
        assert len(digests[level]) == 51
        assert digests[level] == digests["baseline"]
    if len(digests) == 1:
        pytest.skip("this machine has the baseline alone")


def test_an_unknown_level_is_refused_by_name() -> None:
    done = run_on("sse9")
    assert "FUSIONSLAM_SIMD is 'sse9', expected one of baseline, avx2, avx512" in done.stderr
