# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Descriptors against the authors' programs, a NumPy version of the papers, and their promises."""

import colorsys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import fusionslam

Points = NDArray[np.float32]
Colors = NDArray[np.uint8]

SCANS = {
    "00/000094": "kitti/sequences/00/velodyne/000094.bin",
    "00/000198": "kitti/sequences/00/velodyne/000198.bin",
    "08/000720": "kitti/sequences/08/velodyne/000720.bin",
    "08/001500": "kitti/sequences/08/velodyne/001500.bin",
    "raw/0": "kitti/raw_2011_09_26/velodyne_points/data/0000000000.bin",
}
NORMAL_RADIUS = 0.323908135
"""Of reference/cm2dp: 5 x its resolution 0.0647816269."""


def read_scan(path: Path) -> Points:
    return np.fromfile(path, np.float32).reshape(-1, 4)[:, :3].copy()


def street(seed: int, count: int = 4000) -> tuple[Points, Colors]:
    """A coloured synthetic cloud: ground, two unlike house fronts and some poles."""
    rng = np.random.default_rng(seed)
    ground = rng.uniform([-30, -6, -0.05], [45, 8, 0.05], (count // 2, 3))
    left = rng.uniform([-25, 7.9, 0], [20, 8.1, 7], (count // 4, 3))
    right = rng.uniform([-5, -6.1, 0], [40, -5.9, 4], (count // 8, 3))
    feet = rng.uniform([-30, -5, 0], [45, 7, 0], (count // 80, 3))
    poles = np.repeat(feet, 10, axis=0)
    poles[:, 2] = rng.uniform(0, 5, len(poles))
    points = np.concatenate([ground, left, right, poles]).astype(np.float32)
    shades = rng.integers(0, 256, (4, 3))
    sizes = [len(ground), len(left), len(right), len(poles)]
    colors = np.repeat(shades, sizes, axis=0) + rng.integers(-20, 21, (len(points), 3))
    return points, np.clip(colors, 0, 255).astype(np.uint8)


def random_axes(rng: np.random.Generator, *, mirrored: bool) -> NDArray[np.float64]:
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    if (np.linalg.det(axes) < 0) != mirrored:
        axes[0] = -axes[0]
    return axes


def moves(seed: int) -> dict[str, Callable[[Points], Points]]:
    """Rotation, shift, flips, and all at once."""
    rng = np.random.default_rng(seed)
    turn, mirror = random_axes(rng, mirrored=False), random_axes(rng, mirrored=True)
    shift, flip = rng.uniform(-20, 20, 3), np.diag([1.0, -1.0, 1.0])

    def moved(axes: NDArray[np.float64], by: NDArray[np.float64]) -> Callable[[Points], Points]:
        return lambda points: (points.astype(np.float64) @ axes.T + by).astype(np.float32)

    return {
        "turned": moved(turn, np.zeros(3)),
        "shifted": moved(np.eye(3), shift),
        "flipped in y": moved(flip, np.zeros(3)),
        "flipped in x, y and z": moved(-np.eye(3), np.zeros(3)),
        "turned, flipped and shifted": moved(mirror, shift),
    }


def distance(a: NDArray[np.floating], b: NDArray[np.floating]) -> float:
    return float(np.linalg.norm(a.astype(np.float64) - b.astype(np.float64)))


def distance_up_to_sign(a: NDArray[np.floating], b: NDArray[np.floating]) -> float:
    return min(distance(a, b), distance(a, -b))


# An independent M2DP, straight from FACTS: double precision, square roots, arc tangents, an SVD


def principal_coordinates(points: Points) -> NDArray[np.float64]:
    centred = points.astype(np.float64) - points.astype(np.float64).mean(axis=0)
    _, vectors = np.linalg.eigh(centred.T @ centred)
    axes = vectors[:, ::-1].T
    largest = np.abs(axes).argmax(axis=1)
    return centred @ (axes * np.sign(axes[range(3), largest])[:, None]).T


def numpy_signature(
    points: Points,
    colors: Colors | None = None,
    *,
    azimuths: int = 4,
    elevations: int = 16,
    rings: int = 8,
    sectors: int = 16,
    color_bins: int = 16,
) -> NDArray[np.float64]:
    cloud = principal_coordinates(points)
    ring_edges = np.linspace(0, np.sqrt(np.linalg.norm(cloud, axis=1).max()), rings + 1) ** 2
    sector_edges = np.linspace(-np.pi, np.pi, sectors + 1)
    rows = []
    for azimuth in np.linspace(-np.pi / 2, np.pi / 2, azimuths):
        for elevation in np.linspace(0, np.pi / 2, elevations):
            flat = np.cos(elevation)
            normal = np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
            x_axis = np.array([1.0, 0, 0]) - normal[0] * normal
            x, y = cloud @ x_axis, cloud @ np.cross(normal, x_axis)
            angle = np.where((x == 0) & (y == 0), 0, np.arctan2(y, x))
            ring = np.searchsorted(ring_edges[1:-1], np.sqrt(x * x + y * y), side="right")
            sector = np.searchsorted(sector_edges[1:-1], angle, side="right")
            blocks = [np.bincount(ring * sectors + sector, minlength=rings * sectors)]
            if colors is not None:
                shade = np.floor(colors / (255 / color_bins + 0.001)).astype(int)
                blocks += [
                    np.bincount(ring * color_bins + shade[:, c], minlength=rings * color_bins)
                    for c in range(3)
                ]
            rows.append(np.concatenate(blocks) / len(points))
    return np.array(rows)


def numpy_descriptor(signature: NDArray[np.float64]) -> NDArray[np.float64]:
    u, _, vt = np.linalg.svd(signature)
    return np.concatenate([u[:, 0], vt[0]]) * (1 if u[:, 0].sum() >= 0 else -1)


def votes_that_differ(a: NDArray[np.float64], b: NDArray[np.float64], points: int) -> int:
    """Votes in another bin; a vote that only one of the two has counts as half of one."""
    return round(float(np.abs(a - b).sum() * points)) // 2


CONFIGURATIONS: list[dict[str, int]] = [
    {},
    {"azimuths": 3, "elevations": 5},
    {"rings": 5, "sectors": 12},
    {"rings": 1, "sectors": 7},
    {"rings": 3, "sectors": 1},
    {"azimuths": 6, "elevations": 8, "rings": 10, "sectors": 9, "color_bins": 8},
]


@pytest.mark.parametrize("sizes", CONFIGURATIONS)
@pytest.mark.parametrize("seed", [1, 2])
def test_the_paper_preset_is_what_a_plain_numpy_version_gives(
    sizes: dict[str, int], seed: int
) -> None:
    points, colors = street(seed, 800)
    config = fusionslam.M2dpConfig(preset="paper", **sizes)
    for shades in (None, colors):
        expected = numpy_signature(points, shades, **sizes)
        if shades is None:
            signature = fusionslam.m2dp_signature(points, config=config)
            descriptor = fusionslam.m2dp(points, config=config)
        else:
            signature = fusionslam.cm2dp_signature(points, shades, config=config)
            descriptor = fusionslam.cm2dp(points, shades, config=config)
        assert signature.shape == expected.shape
        assert votes_that_differ(signature, expected, len(points)) <= 1
        assert distance(descriptor, numpy_descriptor(expected)) <= 1e-4


def test_a_signature_row_counts_every_point_once_for_shape_and_once_a_channel() -> None:
    points, colors = street(3, 800)
    signature = fusionslam.cm2dp_signature(points, colors, preset="paper")
    shape, *channels = np.split(signature, 4, axis=1)
    assert np.allclose(shape.sum(axis=1), 1)
    for channel in channels:
        assert np.allclose(
            channel.reshape(64, 8, 16).sum(axis=2), shape.reshape(64, 8, 16).sum(axis=2)
        )


# The authors' own programs


@pytest.fixture(scope="session")
def colored_cloud(test_data: Path) -> tuple[Points, Colors]:
    stored = np.load(test_data / "reference/cm2dp/colored_cloud.npz")
    return stored["xyz"], stored["rgb"]


@pytest.fixture(scope="session")
def first_scan(test_data: Path) -> Points:
    return read_scan(test_data / "kitti/sequences/00/velodyne/000000.bin")


def test_the_paper_preset_gives_the_signature_of_the_matlab_program(
    test_data: Path, first_scan: Points
) -> None:
    expected = np.load(test_data / "reference/m2dp/kitti00_000000_signature_64x128.npy")
    signature = fusionslam.m2dp_signature(first_scan, preset="paper")
    assert signature.shape == (64, 128) and signature.dtype == np.float64
    assert votes_that_differ(signature, expected, len(first_scan)) <= 64
    values = np.linalg.svd(signature, compute_uv=False)[:4]
    published = [1.17769527464, 0.722186925664, 0.371539746471, 0.360755386843]
    assert values == pytest.approx(published, abs=1e-6)


def test_the_author_preset_moves_at_most_64_votes_and_leaves_out_the_last_point(
    test_data: Path, first_scan: Points
) -> None:
    count = len(first_scan)
    expected = np.load(test_data / "reference/m2dp/kitti00_000000_signature_64x128.npy")
    signature = fusionslam.m2dp_signature(first_scan, preset="author")
    missing = (expected.sum(axis=1) - signature.sum(axis=1)) * count
    assert missing == pytest.approx(np.ones(64), abs=1e-6)
    differing = round(float(np.abs(signature - expected).sum() * count))
    assert (differing - 64) / 2 <= 64  # float axes move votes at edges


@pytest.mark.parametrize("preset", ["paper", "author"])
def test_m2dp_of_the_first_kitti_scan_is_that_of_the_matlab_program(
    test_data: Path, first_scan: Points, preset: str
) -> None:
    expected = np.load(test_data / "reference/m2dp/kitti00_000000_descriptor_192.npy")
    assert distance_up_to_sign(fusionslam.m2dp(first_scan, preset=preset), expected) <= 1e-4


def test_author_m2dp_is_that_of_the_authors_program(
    test_data: Path, colored_cloud: tuple[Points, Colors]
) -> None:
    expected = np.load(test_data / "reference/cm2dp/m2dp_192.npy")
    assert distance(fusionslam.m2dp(colored_cloud[0], preset="author"), expected) <= 1e-4


@pytest.mark.parametrize("color_space", ["rgb", "hsv", "lab"])
def test_author_cm2dp_is_that_of_the_authors_program(
    test_data: Path, colored_cloud: tuple[Points, Colors], color_space: str
) -> None:
    expected = np.load(test_data / f"reference/cm2dp/cm2dp_{color_space}_576.npy")
    given = fusionslam.cm2dp(*colored_cloud, color_space=color_space, preset="author")
    assert distance(given, expected) <= 1e-4


def test_normals_are_those_of_the_authors_program(
    test_data: Path, colored_cloud: tuple[Points, Colors]
) -> None:
    stored = np.load(test_data / "reference/cm2dp/normals.npz")["normals"]
    normals, curvatures, indices = fusionslam.estimate_normals(
        colored_cloud[0], radius=NORMAL_RADIUS
    )
    assert np.array_equal(colored_cloud[0][indices], stored[:, :3])
    flips = np.sign((normals * stored[:, 3:6]).sum(axis=1, keepdims=True))
    assert np.abs(normals * flips - stored[:, 3:6]).max() <= 1e-4
    assert np.abs(curvatures - stored[:, 6]).max() <= 1e-4


def test_shot_and_cshot_are_those_of_the_authors_program(
    test_data: Path, colored_cloud: tuple[Points, Colors]
) -> None:
    points, colors = colored_cloud
    folder = test_data / "reference/cm2dp"
    shot = fusionslam.shot(points, normal_radius=NORMAL_RADIUS)
    cshot = fusionslam.cshot(points, colors, normal_radius=NORMAL_RADIUS)
    assert distance(shot, np.load(folder / "shot_352.npy")) <= 1e-4
    assert distance(cshot, np.load(folder / "cshot_1344.npy")) <= 1e-4


def test_the_resolution_is_that_of_the_authors_program(
    colored_cloud: tuple[Points, Colors],
) -> None:
    assert fusionslam.cloud_resolution(colored_cloud[0]) == pytest.approx(0.0647816269, abs=1e-9)


def test_without_a_radius_shot_takes_five_times_the_resolution() -> None:
    points, colors = street(4, 1000)
    radius = 5 * fusionslam.cloud_resolution(points)
    assert np.array_equal(fusionslam.shot(points), fusionslam.shot(points, normal_radius=radius))
    assert np.array_equal(
        fusionslam.cshot(points, colors), fusionslam.cshot(points, colors, normal_radius=radius)
    )


# Normals and resolution against SciPy


def test_the_resolution_is_the_mean_distance_to_the_nearest_neighbour() -> None:
    from scipy.spatial import KDTree

    points, _ = street(5, 1000)
    nearest = KDTree(points).query(points, k=2)[0][:, 1]
    assert fusionslam.cloud_resolution(points) == pytest.approx(nearest.mean(), rel=1e-5)


def test_normals_are_the_directions_of_least_spread_and_look_at_the_origin() -> None:
    from scipy.spatial import KDTree

    points, _ = street(6, 1000)
    tree, radius = KDTree(points), 2.0
    normals, curvatures, indices = fusionslam.estimate_normals(points, radius=radius)
    assert ((normals * points[indices]).sum(axis=1) <= 1e-3).all()
    assert np.linalg.norm(normals, axis=1) == pytest.approx(np.ones(len(normals)), abs=1e-5)
    compared = 0
    for normal, curvature, i in zip(normals, curvatures, indices, strict=True):
        near = points[tree.query_ball_point(points[i], radius)].astype(np.float64)
        spread, axes = np.linalg.eigh(np.cov(near.T, bias=True))
        if spread[1] - spread[0] < 0.02:
            continue  # no clear direction of least spread
        compared += 1
        assert abs(normal @ axes[:, 0]) == pytest.approx(1, abs=1e-3)
        assert curvature == pytest.approx(spread[0] / spread.sum(), abs=1e-3)
    assert compared > len(indices) // 2


def test_points_with_fewer_than_three_neighbours_have_no_normal() -> None:
    points, _ = street(7, 1000)
    far = np.array([[500, 0, 0], [501, 0, 0]], np.float32)
    _, _, indices = fusionslam.estimate_normals(np.concatenate([points, far]), radius=2.0)
    assert indices.max() < len(points)


# Colour spaces


def bins_of_color(color: tuple[int, int, int], color_space: str, preset: str) -> list[int]:
    """The histogram bin of each channel, read from the signature of a cloud of one colour."""
    points = np.array([[0, 0, 0], [3, 0, 0], [0, 2, 0], [1, 1, 1], [4, 1, 2]], np.float32)
    colors = np.full((len(points), 3), color, np.uint8)
    signature = fusionslam.cm2dp_signature(points, colors, color_space=color_space, preset=preset)
    channels = signature[:, 128:].reshape(64, 3, 8, 16).sum(axis=(0, 2))
    assert ((channels > 0).sum(axis=1) == 1).all()
    return [int(bin_) for bin_ in channels.argmax(axis=1)]


def linear_from_srgb(value: float, deciding: float) -> float:
    return ((value + 0.055) / 1.055) ** 2.4 if deciding > 0.04045 else value / 12.92


def cie_lab(color: tuple[int, int, int], *, author: bool) -> list[float]:
    """IEC 61966-2-1 and CIE 15: L, a, b, scaled to 0 .. 1 as c-M2DP does.

    The author decides about green and blue by the red value that is already linear.
    """
    r, g, b = (value / 255 for value in color)
    red = linear_from_srgb(r, r)
    green = linear_from_srgb(g, red if author else g)
    blue = linear_from_srgb(b, red if author else b)
    matrix = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    ratios = np.array(matrix) @ [red, green, blue] / [0.95047, 1.0, 1.08883]
    threshold = (6 / 29) ** 3
    fx, fy, fz = np.where(
        ratios > threshold, np.cbrt(ratios), ratios / (3 * (6 / 29) ** 2) + 4 / 29
    )
    return [(116 * fy - 16) / 100, (500 * (fx - fy) + 128) / 255, (200 * (fy - fz) + 128) / 255]


def expected_values(color: tuple[int, int, int], color_space: str, preset: str) -> list[float]:
    if color_space == "rgb":
        return [value / 255 for value in color]
    if color_space == "hsv":
        return list(colorsys.rgb_to_hsv(*(value / 255 for value in color)))
    return cie_lab(color, author=preset == "author")


SPECIAL_COLORS = [
    (r, g, b) for r in (0, 128, 255) for g in (0, 128, 255) for b in (0, 128, 255)
] + [(11, 10, 10), (12, 3, 9), (60, 10, 5), (1, 0, 0), (0, 0, 1), (254, 255, 255)]


@pytest.mark.parametrize("preset", ["paper", "author"])
@pytest.mark.parametrize("color_space", ["rgb", "hsv", "lab"])
def test_colours_fall_into_the_bins_of_the_standard_formulas(color_space: str, preset: str) -> None:
    rng = np.random.default_rng(8)
    drawn = [(int(r), int(g), int(b)) for r, g, b in rng.integers(0, 256, (120, 3))]
    width = {"rgb": (255 / 16 + 0.001) / 255}.get(color_space, 1 / 16 + 0.001)
    for color in SPECIAL_COLORS + drawn:
        places = np.array(expected_values(color, color_space, preset)) / width
        clear = np.abs(places - np.rint(places)) > 0.01  # the matrices above have four digits
        if color_space != "lab":
            clear[:] = True
        given = np.array(bins_of_color(color, color_space, preset))
        assert np.array_equal(given[clear], np.floor(places[clear])), color


def test_half_the_exposure_leaves_the_robust_descriptor_unchanged() -> None:
    points, colors = street(8)
    bright = colors // 2 * 2
    dark = fusionslam.cm2dp(points, bright // 2)
    assert distance(dark, fusionslam.cm2dp(points, bright)) <= 1e-4
    plain = [fusionslam.cm2dp(points, c, preset="paper") for c in (bright, bright // 2)]
    assert distance(*plain) > 0.1  # what it would be otherwise


# What "robust" promises


@pytest.fixture(scope="session")
def scans(test_data: Path) -> dict[str, Points]:
    return {name: read_scan(test_data / path) for name, path in SCANS.items()}


def test_the_robust_preset_is_the_default_and_keeps_the_lengths() -> None:
    points, colors = street(9)
    m2dp, cm2dp = fusionslam.m2dp(points), fusionslam.cm2dp(points, colors)
    assert m2dp.shape == (192,) and m2dp.dtype == np.float32
    assert cm2dp.shape == (576,) and cm2dp.dtype == np.float32
    assert np.array_equal(m2dp, fusionslam.m2dp(points, preset="robust"))
    assert np.array_equal(cm2dp, fusionslam.cm2dp(points, colors, preset="robust"))


@pytest.mark.parametrize("sizes", [{"azimuths": 6}, {"sectors": 9}])
def test_sizes_that_the_robust_rule_cannot_use_are_refused_by_name(sizes: dict[str, int]) -> None:
    with pytest.raises(fusionslam.ConfigError, match=rf"m2dp\.{next(iter(sizes))} is "):
        fusionslam.m2dp(street(9)[0], config=fusionslam.M2dpConfig(**sizes))


@pytest.mark.parametrize("seed", range(4))
def test_moving_a_synthetic_cloud_leaves_the_robust_descriptor_unchanged(seed: int) -> None:
    points, colors = street(10 + seed)
    for what, move in moves(seed).items():
        moved = move(points)
        assert distance(fusionslam.m2dp(moved), fusionslam.m2dp(points)) <= 1e-4, what
        assert distance(fusionslam.cm2dp(moved, colors), fusionslam.cm2dp(points, colors)) <= 1e-4
    order = np.random.default_rng(seed).permutation(len(points))
    assert distance(fusionslam.m2dp(points[order]), fusionslam.m2dp(points)) <= 1e-4


@pytest.mark.parametrize("name", SCANS)
def test_moving_a_real_scan_leaves_the_robust_descriptor_unchanged(
    scans: dict[str, Points], name: str
) -> None:
    points = scans[name]
    colors = (np.abs(points) * 20 % 256).astype(np.uint8)
    m2dp, cm2dp = fusionslam.m2dp(points), fusionslam.cm2dp(points, colors)
    author = fusionslam.m2dp(points, preset="author")
    for number, (what, move) in enumerate(moves(20).items()):
        moved = move(points)
        change = distance(fusionslam.m2dp(moved), m2dp)
        author_change = distance(fusionslam.m2dp(moved, preset="author"), author)
        print(f"{name} {what}: robust {change:.1e}, author {author_change:.1e}")
        assert change <= 1e-4, what
        if number == 4:
            assert distance(fusionslam.cm2dp(moved, colors), cm2dp) <= 1e-4, what


@pytest.mark.parametrize("name", SCANS)
def test_a_scan_that_lost_a_tenth_of_its_points_is_nearest_to_itself(
    scans: dict[str, Points], name: str
) -> None:
    rng = np.random.default_rng(21)
    thinned = scans[name][rng.random(len(scans[name])) >= 0.1]
    for preset in ("robust", "author"):
        given = fusionslam.m2dp(thinned, preset=preset)
        distances = {
            other: distance(given, fusionslam.m2dp(points, preset=preset))
            for other, points in scans.items()
        }
        nearest_other = min(value for other, value in distances.items() if other != name)
        print(f"{name} {preset}: itself {distances[name]:.4f}, nearest other {nearest_other:.4f}")
        if preset == "robust":
            assert distances[name] < nearest_other


def test_a_synthetic_cloud_that_lost_a_tenth_of_its_points_is_nearest_to_itself() -> None:
    clouds = [street(30 + seed)[0] for seed in range(4)]
    clouds = [cloud * [1, 1 + 0.3 * i, 1 + 0.5 * i] for i, cloud in enumerate(clouds)]
    known = [fusionslam.m2dp(cloud) for cloud in clouds]
    rng = np.random.default_rng(22)
    for i, cloud in enumerate(clouds):
        given = fusionslam.m2dp(cloud[rng.random(len(cloud)) >= 0.1])
        assert int(np.argmin([distance(given, other) for other in known])) == i


def mean_change(points: Points, noise: float, seeds: int = 4) -> float:
    """Mean change of the robust descriptor under this much noise on each coordinate."""
    known, changes = fusionslam.m2dp(points), []
    for seed in range(seeds):
        shake = np.random.default_rng(seed).normal(0, noise, points.shape)
        changes.append(distance(fusionslam.m2dp((points + shake).astype(np.float32)), known))
    return float(np.mean(changes))


def test_less_noise_changes_the_robust_descriptor_less() -> None:
    for seed in range(3):
        points, _ = street(40 + seed)
        full, half, quarter = (mean_change(points, noise) for noise in (0.04, 0.02, 0.01))
        assert quarter < half < full < 0.05
        assert quarter < 0.75 * full


def test_a_centimetre_of_noise_on_a_real_scan_changes_the_robust_descriptor_little(
    scans: dict[str, Points],
) -> None:
    changes = {noise: 0.0 for noise in (0.01, 0.005)}
    for points in scans.values():
        for noise in changes:
            change = mean_change(points[::4], noise, seeds=2)
            changes[noise] += change / len(scans)
            assert change < 0.005
    print(f"mean change by noise: {changes}")
    assert changes[0.005] < changes[0.01]


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_nearly_symmetric_cloud_does_not_jump(axis: int) -> None:
    rng = np.random.default_rng(50 + axis)
    half = rng.normal(size=(3000, 3)) * [20, 8, 2] + [4, 1.5, 0.6]
    mirrored = half.copy()
    mirrored[:, axis] *= -1
    symmetric = np.concatenate([half, mirrored])
    descriptors = []
    for lean in np.linspace(-1e-3, 1e-3, 9):  # from just left of symmetric to just right of it
        leaning = symmetric.copy()
        leaning[:, axis] += lean * np.abs(leaning[:, axis])
        descriptors.append(fusionslam.m2dp(leaning.astype(np.float32)))
    steps = [distance(a, b) for a, b in pairwise(descriptors)]
    assert max(steps) < 0.01


# Repeatability

CALLS: dict[str, Callable[..., NDArray[np.floating]]] = {
    "m2dp robust": lambda p, c, n: fusionslam.m2dp(p, threads=n),
    "m2dp paper": lambda p, c, n: fusionslam.m2dp(p, preset="paper", threads=n),
    "m2dp author": lambda p, c, n: fusionslam.m2dp(p, preset="author", threads=n),
    "m2dp_signature": lambda p, c, n: fusionslam.m2dp_signature(p, threads=n),
    "cm2dp rgb": lambda p, c, n: fusionslam.cm2dp(p, c, threads=n),
    "cm2dp hsv": lambda p, c, n: fusionslam.cm2dp(p, c, color_space="hsv", threads=n),
    "cm2dp lab": lambda p, c, n: fusionslam.cm2dp(
        p, c, color_space="lab", preset="author", threads=n
    ),
    "cm2dp_signature": lambda p, c, n: fusionslam.cm2dp_signature(p, c, threads=n),
    "shot": lambda p, c, n: fusionslam.shot(p, threads=n),
    "cshot": lambda p, c, n: fusionslam.cshot(p, c, threads=n),
    "normals": lambda p, c, n: fusionslam.estimate_normals(p, radius=1.0, threads=n)[0],
}


@pytest.mark.parametrize("call", CALLS)
def test_two_runs_and_one_or_two_threads_give_the_same_bytes(call: str) -> None:
    points, colors = street(60)
    results = {CALLS[call](points, colors, threads).tobytes() for threads in (1, 1, 2, 2, 0)}
    assert len(results) == 1


# Descriptors by name


@pytest.mark.parametrize(
    ("name", "length"), [("m2dp", 192), ("cm2dp", 576), ("shot", 352), ("cshot", 1344)]
)
def test_describe_by_name_is_the_function_of_that_name(name: str, length: int) -> None:
    points, colors = street(61, 1000)
    arguments = (points, colors) if name.startswith("c") else (points,)
    given = fusionslam.describe(fusionslam.Cloud(points, colors), name)
    assert given.shape == (length,) and given.dtype == np.float32
    assert np.array_equal(given, getattr(fusionslam, name)(*arguments))


def test_describe_obeys_its_configuration() -> None:
    points, colors = street(62, 1000)
    config = fusionslam.DescriptorConfig(preset="author", color_space="lab", threads=2)
    given = fusionslam.describe(fusionslam.Cloud(points, colors), "cm2dp", config)
    expected = fusionslam.cm2dp(points, colors, preset="author", color_space="lab")
    assert np.array_equal(given, expected)


def test_describe_names_what_is_missing_or_unknown() -> None:
    points, _ = street(63, 200)
    with pytest.raises(fusionslam.DataError, match="cm2dp needs colours"):
        fusionslam.describe(fusionslam.Cloud(points), "cm2dp")
    with pytest.raises(fusionslam.ConfigError, match=r"'m3dp'.*known: m2dp, cm2dp, shot, cshot"):
        fusionslam.describe(fusionslam.Cloud(points), "m3dp")


# Neighbouring places


def test_neighbouring_kitti_frames_are_nearer_than_unrelated_ones(test_data: Path) -> None:
    folder = test_data / "kitti/sequences"
    names = ("00/94", "00/95", "00/198", "00/199", "08/720", "08/1500")
    found = {}
    for name in names:
        sequence, number = name.split("/")
        found[name] = read_scan(folder / sequence / f"velodyne/{int(number):06d}.bin")
    kinds: dict[str, Callable[[Points], NDArray[np.float32]]] = {
        "robust": fusionslam.m2dp,
        "author": lambda points: fusionslam.m2dp(points, preset="author"),
        "shot": lambda points: fusionslam.shot(points[::8]),
    }
    for kind, compute in kinds.items():
        vectors = {name: compute(points) for name, points in found.items()}
        for a, b in (("00/94", "00/95"), ("00/198", "00/199")):
            unrelated = [distance(vectors[a], vectors[c]) for c in names if c not in (a, b)]
            assert distance(vectors[a], vectors[b]) < min(unrelated), kind
