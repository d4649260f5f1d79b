# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The simulated camera: pinhole, distortion, exposure and noise."""

import numpy as np
import pytest
from scipy import optimize

pytest.importorskip("embreex", reason="the simulator is an extra")

from fusionslam.errors import ConfigError
from fusionslam.sim.camera import (
    CameraMount,
    camera_info,
    camera_rays,
    distort,
    gains,
    parent_from_camera,
    photograph,
    projection,
    undistort,
)
from fusionslam.sim.scene import RayCaster
from fusionslam.sim.world import scene_of
from rows import rows
from worlds import EVEN, PLAIN, block, hall

LEVEL = {"position_m": (0.0, 0.0, 0.0), "tilt_deg": (0.0, 0.0, 0.0), "noise": 0.0}
LENS = (-0.28, 0.07, 0.0008, -0.0005, -0.01)


def brown(x: float, y: float, lens: tuple[float, ...]) -> tuple[float, float]:
    """The plumb-bob model as CameraInfo's documentation spells it, one point at a time."""
    k1, k2, p1, p2, k3 = lens
    r2 = x**2 + y**2
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    return (
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2),
        y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y,
    )


def test_rays_meet_their_pixels_again_in_the_field_of_view() -> None:
    matrix = CameraMount(width=640, height=480, view_rad=1.0).matrix()
    assert matrix[0, 0] == matrix[1, 1] == pytest.approx(585.756, abs=1e-3)
    assert tuple(matrix[:2, 2]) == (320, 240)
    camera = CameraMount(**LEVEL, width=64, height=48, focal_px=50.0, centre_px=(30.5, 21.25))
    rays = camera_rays(camera)
    pixels = np.einsum("ij,nj->ni", projection(camera)[:, :3], rays)
    u, v = np.meshgrid(np.arange(64), np.arange(48))
    assert np.allclose(pixels[:, 0] / pixels[:, 2], u.ravel(), atol=1e-4)
    assert np.allclose(pixels[:, 1] / pixels[:, 2], v.ravel(), atol=1e-4)
    assert tuple(rays[0]) == pytest.approx((-30.5 / 50, -21.25 / 50, 1))


def test_optical_axes_are_right_down_and_forward_and_a_baseline_is_to_the_right() -> None:
    pose = parent_from_camera(CameraMount(**LEVEL))
    assert np.allclose(pose[:3, :3].T, [(0, -1, 0), (0, 0, -1), (1, 0, 0)])
    camera = CameraMount(**LEVEL, baseline_m=0.3, side="right")
    apart = parent_from_camera(camera, right=True)[:3, 3] - parent_from_camera(camera)[:3, 3]
    assert np.allclose(apart, (0, -0.3, 0))
    assert camera_info(camera, 5).projection[0, 3] == pytest.approx(-camera.focal_px * 0.3)


def test_distortion_follows_the_formulas_of_camera_info() -> None:
    places = np.random.default_rng(3).uniform(-0.6, 0.6, (50, 2))
    assert np.allclose(distort(places, LENS), [brown(x, y, LENS) for x, y in places], atol=1e-12)


@rows("lens", [LENS, (0.2, -0.05, 0.001, 0.002, 0.01), (0, 0, 0.01, -0.01, 0)])
def test_undistorting_undoes_distortion(lens: tuple[float, ...]) -> None:
    places = np.random.default_rng(4).uniform(-0.55, 0.55, (400, 2))
    assert np.allclose(undistort(distort(places, lens), lens), places, atol=1e-8)
    target = np.array([0.41, -0.32])
    root = optimize.fsolve(lambda at: np.array(brown(at[0], at[1], lens)) - target, target)
    assert np.allclose(undistort(target[None], lens)[0], root, atol=1e-8)


def test_a_picture_shows_corners_where_the_distorted_model_puts_them() -> None:
    corner = np.array([4.0, 1.8, 1.2])  # front, upper, left
    scene = scene_of([block("box", (4, -1, -1), (5, 1.8, 1.2))], [PLAIN], EVEN)
    camera = CameraMount(**LEVEL, width=320, height=240, view_rad=1.0, distortion=LENS)
    pose = parent_from_camera(camera)
    image = photograph(RayCaster(scene), camera, pose, (0.5, 0.5, 0.5), np.random.default_rng(0))
    x, y, z = pose[:3, :3].T @ corner
    u, v = camera.matrix()[:2, :2] @ brown(x / z, y / z, LENS) + camera.matrix()[:2, 2]
    # The box is grey 127 or 128, the sky is not.
    inside = np.ptp(image, axis=2) == 0
    rows, columns = np.nonzero(inside)
    upper_left = np.argmin(columns + rows)
    assert abs(columns[upper_left] - u) < 1.5 and abs(rows[upper_left] - v) < 1.5
    straight = CameraMount(**LEVEL, width=320, height=240, view_rad=1.0).matrix()
    plain = straight[0, 0] * x / z + straight[0, 2]
    assert abs(u - plain) > 3  # the distortion is one that shows


def test_rays_without_distortion_are_those_of_zeros() -> None:
    none, zeros = (camera_rays(CameraMount(**LEVEL, distortion=lens)) for lens in ((), (0.0,) * 5))
    assert np.array_equal(none, zeros)


def test_pixel_noise_has_the_configured_deviation_and_gains_scale_channels() -> None:
    caster = RayCaster(hall().visual)
    pose = parent_from_camera(CameraMount(**LEVEL))
    pose[2, 3] = 0.5
    size = {"width": 160, "height": 120, "view_rad": 0.5}

    def shot(noise: float, gain: tuple[float, float, float]) -> np.ndarray:
        camera = CameraMount(**(LEVEL | size | {"noise": noise}))
        return photograph(caster, camera, pose, gain, np.random.default_rng(1)).astype(float)

    half = shot(0.0, (0.5, 0.5, 0.5))
    error = shot(3.0, (0.5, 0.5, 0.5)) - half
    inside = (half > 20) & (half < 235)
    # Rounding adds 1/12 to the variance.
    assert error[inside].std() == pytest.approx(np.sqrt(9 + 1 / 12), rel=0.02)
    quarter = shot(0.0, (0.5, 0.25, 0.5))
    assert np.allclose(quarter[..., 1], half[..., 1] / 2, atol=1)
    assert np.array_equal(quarter[..., ::2], half[..., ::2])


def test_exposure_drifts_slowly_by_the_configured_deviation() -> None:
    camera = CameraMount(gain_drift=(0.1, 0.0, 0.05), gain_period_s=20.0)
    seconds = np.arange(0, 2000, 0.5)
    drift = np.log([gains(camera, s, np.random.default_rng(6)) for s in seconds])
    assert drift.std(axis=0) == pytest.approx((0.1, 0.0, 0.05), rel=0.1, abs=1e-12)
    assert np.abs(np.diff(drift[:, 0])).max() < 0.1
    again = gains(camera, 12.5, np.random.default_rng(6))
    assert np.array_equal(np.log(again), drift[25])


def test_camera_info_says_what_the_picture_was_made_with() -> None:
    camera = CameraMount(width=64, height=48, view_rad=1.0, distortion=LENS, frame_id="eye")
    info = camera_info(camera, 42)
    assert (info.stamp_ns, info.frame_id, info.size) == (42, "eye", (64, 48))
    assert np.array_equal(info.camera_matrix, camera.matrix())
    assert tuple(info.distortion) == LENS and info.distortion_model == "plumb_bob"
    assert np.array_equal(info.projection[:, :3], camera.matrix())


@rows(
    "values, message",
    [
        ({"distortion": (0.1, 0.2)}, r"distortion .*\b2\b.*\b5\b"),
        ({"distortion": (-9.0, 0.0, 0.0, 0.0, 0.0)}, r"distortion .*-9\.0.* x/z"),
        ({"view_rad": 3.2}, "view_rad"),
        ({"side": "middle"}, "'left' or 'right'"),
        ({"stored": "gif"}, "stored"),
    ],
)
def test_a_camera_that_cannot_be_is_refused(values: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        CameraMount(**values)
