# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How far is visual odometry from the truth, and what map does a camera make? Markdown tables.

    python -m benchmarks.accuracy.ratslam_visual_odometry [--write]

Drives of the test data are rendered at 10 Hz by a camera of a quarter of the robot's columns and
rows: the whole ones would take a quarter of an hour. Made worlds are seen in their bags, at 2 Hz
and by the whole camera. Maps are made of visual odometry and of visual templates, which the whole
camera sees. Worlds of the test data are left out where FUSIONSLAM_TEST_DATA does not name them.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.accuracy.data import ROOT, world_files
from benchmarks.accuracy.markdown import table, write_between
from fusionslam.cli.recordings import build_recording
from fusionslam.evaluation.maps.judge import judge_map
from fusionslam.geometry.trajectory import Trajectory, read_trajectory
from fusionslam.pipelines.drive_images import image_stamps_ns, visual_motions, visual_speeds
from fusionslam.pipelines.drives import open_drive
from fusionslam.pipelines.map_events import events_of, expected_drift
from fusionslam.pipelines.maps import RunRecorder, run_events
from fusionslam.ratslam import RatSlam, RatSlamConfig, TemplateSource
from fusionslam.ratslam.visual_odometry import VisualOdometry, VisualSpeed, fit_speed
from fusionslam.sensors.image_series import ImageSeries
from fusionslam.sim.rendered_images import rendered_images

PAGE = ROOT / "docs" / "guides" / "visual_odometry.md"
CAMERA = Path(__file__).with_name("quarter_camera.yaml")
MADE = ("warehouse", "house", "hospital")
HEADER = ["drive", "images", "preset", "turn rate off by", "in 90 % by less than", "heading off by"]
HEADER += ["speed off by", "way seen of way driven", "fitted", "doubted"]
MAPS = ["drive", "preset of the map", "odometry alone", "every pose on the map", "its heading"]
MAPS += ["nodes", "arrivals, false", "refused, of them true"]
Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Seen:
    """A drive that a camera saw.

    Attributes:
        name: for people.
        images: of the whole drive.
        way: where the camera's robot truly was.
    """

    name: str
    images: ImageSeries
    way: Trajectory


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="put them into the docs")
    arguments = parser.parse_args()
    rendered = list(drives())
    found = {
        "ratslam-visual-odometry": table(
            HEADER, [row for seen in (*rendered, *simulate_drives()) for row in rows(seen)]
        ),
        "ratslam-camera": table(MAPS, [row for seen in rendered for row in map_rows(seen)]),
    }
    print("\n\n".join(found.values()))
    if arguments.write:
        for name, text in found.items():
            write_between(PAGE, name, text)


def drives() -> Iterator[Seen]:
    for name, path in world_files().items():
        way = read_trajectory(path.with_suffix(".trajectory.csv"))
        poses = np.stack([way.x, way.y, way.yaw], axis=1)
        images = rendered_images(path, way.seconds, poses, robot=str(CAMERA))
        assert images.camera is not None and images.camera.size is not None
        used = VisualOdometry().rows_used(images.camera.size[1])
        yield Seen(
            name,
            rendered_images(path, way.seconds, poses, robot=str(CAMERA), bottom=used),
            way,
        )


def simulate_drives() -> Iterator[Seen]:
    for name in MADE:
        drive = open_drive(build_recording(Path(name)))
        made = drive.images()
        assert made is not None
        yield Seen(drive.name, made, drive.true_way())


def rows(seen: Seen) -> Iterator[list[str]]:
    v, w, dt = true_speeds(seen)
    for preset in ("robust", "openratslam"):
        odometry = VisualOdometry(preset=preset, camera=seen.images.camera)
        found = [
            VisualSpeed(0.0, 0.0, gap, 0.0, 0.0, "a gap") if one is None else one
            for one, gap in zip(visual_speeds(seen.images, odometry)[1:], dt, strict=True)
        ]
        off = np.array([one[:2] for one in found]) - np.stack([v, w], axis=1)
        scaled = fit_speed(odometry.config, found, v)
        fitted = (
            f"{scaled.distance_m:.1f} m" if preset == "robust" else f"{scaled.difference_scale:.0f}"
        )
        ways = [float((values * dt).sum()) for values in (v + off[:, 0], v)]
        yield [
            seen.name,
            f"{seen.images.rate_hz:.0f} Hz",
            preset,
            f"{rms(off[:, 1]):.3f} of {rms(w):.3f} rad/s",
            f"{np.quantile(np.abs(off[:, 1]), 0.9):.3f} rad/s",
            f"{np.rad2deg(np.abs(np.cumsum(off[:, 1] * dt))).max():.0f}°",
            f"{rms(off[:, 0]):.2f} of {rms(v):.2f} m/s",
            f"{ways[0]:.0f} of {ways[1]:.0f} m",
            fitted,
            f"{100 * np.mean([bool(one.why) for one in found]):.1f} %",
        ]


def map_rows(seen: Seen) -> Iterator[list[str]]:
    """Maps of a drive out of one camera: its speed, and visual templates."""
    drive = open_drive(world_files()[seen.name].parents[1] / "recordings" / f"{seen.name}.npz")
    odometry = VisualOdometry(camera=seen.images.camera)
    speeds = visual_speeds(seen.images, odometry)
    motions = visual_motions(image_stamps_ns(seen.images), speeds)
    for preset in ("robust", "openratslam"):
        source = TemplateSource()
        events = replace(events_of(drive, source, "truth"), motions=motions, odometry="visual")
        config = RatSlamConfig.model_validate({"preset": preset, "map": expected_drift("visual")})
        recorder = RunRecorder(RatSlam(config, views=source), events)
        run_events(recorder)
        judged = judge_map(recorder.record())
        assert judged.dead_reckoning is not None and judged.trajectory is not None
        yield [
            seen.name,
            preset,
            f"{judged.dead_reckoning.rmse_m:.2f} m",
            f"{judged.trajectory.rmse_m:.2f} m",
            f"{judged.trajectory.heading_rmse_deg:.1f}°",
            str(judged.node_count),
            f"{judged.loops}, {judged.false_loops}",
            f"{judged.refused}, {judged.refused_true}",
        ]


def true_speeds(seen: Seen) -> tuple[Floats, Floats, Floats]:
    """Metres forwards and radians a second, and seconds, from each image to the next."""
    x, y, yaw = seen.way.places(seen.images.seconds)
    dt = np.diff(seen.images.seconds)
    turn = np.diff(np.unwrap(yaw))
    middle = yaw[:-1] + turn / 2
    return (np.cos(middle) * np.diff(x) + np.sin(middle) * np.diff(y)) / dt, turn / dt, dt


def rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


if __name__ == "__main__":
    main()
