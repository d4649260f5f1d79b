# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Fits how probable it is that a registered pose is right, on simulated and real drives.

python -m benchmarks.accuracy.registration_probability           # poses from the cache, or made
python -m benchmarks.accuracy.registration_probability --write   # and store the model and the table

The poses are those of the candidates that correlate most, of every fourth frame: what a detector
registers. Full circles with the camera's colours and stereo clouds are fitted together. The
overlaps of full circles alone make the model of poses for which there are no colours to compare,
unless a cloud shows less than half of the circle or a room: for these a LiDAR's sector of 63
degrees in towns, and sectors and full circles in made houses and warehouses are fitted. To both,
real recordings are fitted, too; each drive counts alike. The table is of other seeds, and of
recordings that nothing was fitted to; FUSIONSLAM_TEST_DATA names their folder. A drive takes about
a minute of processor time.
"""

import argparse
import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from textwrap import fill
from typing import NamedTuple

import numpy as np
import yaml
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from benchmarks.accuracy.data import WORLDS, data_folder
from benchmarks.accuracy.loop_thresholds import FITTED
from benchmarks.accuracy.markdown import table, write_between
from benchmarks.accuracy.presets import ROOT, record_towns
from benchmarks.real.protocol import RIGHT
from benchmarks.real.recordings import read_recording as read_real
from fusionslam import Cloud, DescriptorConfig, FusionConfig, LoopConfig
from fusionslam.base.arrays import Floats, Mask, Matrix
from fusionslam.base.cache import cache_folder
from fusionslam.config import merged
from fusionslam.datasets import open_dataset
from fusionslam.datasets.range_recording import RangeRecording
from fusionslam.descriptors import find_descriptor
from fusionslam.loop_closure import Observation
from fusionslam.loop_closure.local_maps import RecentFrames
from fusionslam.loop_closure.memory import FrameMemory
from fusionslam.loop_closure.observation import FrameObserver
from fusionslam.registration import RegistrationConfig, register, search_poses
from fusionslam.sensors.frame import Frame
from fusionslam.sensors.messages import NANOSECONDS, Scan
from fusionslam.sim.catalogue import MADE, drive_through
from fusionslam.sim.motion.planner import PlanConfig
from fusionslam.sim.robot import base_from, robot_named
from fusionslam.sim.simulator import SimulationConfig, simulate

PAGE = ROOT / "docs" / "stages" / "registration.md"
MODEL = ROOT / "python" / "fusionslam" / "registration" / "probability.yaml"
FEATURES = ("overlap", "mean_overlap", "color_ratio", "log_agreeing", "degenerate")
MODELS = {
    "plain": ("mean_overlap",),
    "colored": ("overlap", "color_ratio"),
    "small": ("overlap", "log_agreeing", "degenerate"),
}
"""Features of each model, as ``pose_probability`` takes them."""
ROBOT = "turtlebot3_waffle_pi"
CIRCLE_ROBOT = "turtlebot3_vlp16"
SECTOR_RAD = 0.55
"""To either side, of the robot's LiDAR, and of the scans of towns that are cut to it."""
ROOMS = ("house", "warehouse")
RECORDED = tuple(f"recorded-{name}" for name in WORLDS)
REAL = "real-"
REAL_FITTED = {"plain": ("kitti_bev_05", "kitti00_keyframes"), "small": ("hku_1", "balm_realworld")}
"""Recordings by the model that they are fitted to."""
CIRCLES = tuple(f"{name}-circle" for name in ROOMS)
FITTED_TO = {
    **dict.fromkeys(("lidar", "stereo"), FITTED),
    **dict.fromkeys(("sector", *ROOMS), FITTED[:3]),
    **dict.fromkeys(CIRCLES, FITTED[:1]),
    **{REAL + name: (0,) for names in REAL_FITTED.values() for name in names},
}
"""Seeds by source."""
REPORTED = {
    **dict.fromkeys(("lidar", "stereo"), (1, 2)),
    "sector": (5, 7),
    **dict.fromkeys((*ROOMS, *CIRCLES), (4, 5)),
    **dict.fromkeys(RECORDED, (0,)),
    **{REAL + name: (0,) for name in ("kitti_bev_06", "hku_2", "redkitchen")},
}
"""Seeds of the table. The features of small views were chosen on 1, 2 and 3, and the recordings."""
KINDS = {
    "full circle, towns": (("lidar",), ("plain",)),
    "full circle, towns, LiDAR and camera": (("lidar",), ("colored", "plain")),
    "full circle, made houses and warehouses": (CIRCLES, ("small",)),
    "stereo, towns": (("stereo",), ("colored", "small")),
    "sector, towns": (("sector",), ("small",)),
    "sector, made houses": (("house",), ("small",)),
    "sector, made warehouses": (("warehouse",), ("small",)),
    "sector, recorded small_house and warehouse": (RECORDED, ("small",)),
    "sector with colours, the same": (RECORDED, ("colored", "small")),
    "real: road from above, `kitti_bev_06`": (("real-kitti_bev_06",), ("plain",)),
    "real: local maps of a sector, `hku_2`": (("real-hku_2",), ("small",)),
    "real: RGB-D, `redkitchen`": (("real-redkitchen",), ("colored",)),
}
"""Sources, and the model, of each row of the table; after it that of poses without colours."""
STEP = 4
"""Of the frames whose candidates are registered."""
REGISTERED = 3
"""Of a frame's candidates."""
METRES, ROOM_METRES, DEGREES = 2.0, 0.3, 5.0
"""Poses less far off are right."""
LIMITS = ((0.5, 1), (1, 1), (1.5, 2))
"""Factors of metres and degrees."""
INDOORS = DescriptorConfig.model_validate({"scan_context": {"max_range": 20, "height": 0.3}})
"""Of candidates in rooms."""
RIDGE = 3e-4
"""Keeps the slopes finite where right and wrong poses do not overlap."""
BINS = (0, 0.05, 0.5, 0.95, 0.99, 1.01)


Models = Mapping[str, Floats]
"""Intercept and slopes by kind of pose."""


class Poses(NamedTuple):
    """Registered poses of some drives.

    Attributes:
        features: float64 (N, 5), ``FEATURES``; the ratio is NaN where no colours are compared.
        errors: float64 (N, 2), as shares of the metres and degrees that a right pose is off at
            most.
        weights: float64 (N,).
    """

    features: Floats
    errors: Floats
    weights: Floats

    @property
    def right(self) -> Mask:
        return within(self.errors, 1, 1)

    def of(self, names: Iterable[str]) -> Floats:
        """float64 (N, F), some features."""
        return self.features[:, [FEATURES.index(name) for name in names]]


def joined(drives: Sequence[Poses]) -> Poses:
    """All poses; each drive counts alike."""
    weights = [each.weights / each.weights.sum() for each in drives if len(each.weights)]
    features, errors, _ = zip(*drives, strict=True)
    return Poses(np.concatenate(features), np.concatenate(errors), np.concatenate(weights))


def within(errors: Floats, metres: float, degrees: float) -> Mask:
    return np.asarray((errors < (metres, degrees)).all(axis=1), np.bool_)


def register_drive(seed: int, source: str, folder: Path) -> Poses:
    """Register the candidates of a drive; ``folder`` keeps the poses.

    Args:
        seed: of the town or room; of a recording it means nothing.
        source: "lidar", "stereo" or "sector" of a town; "house", "warehouse", "house-circle" or
            "warehouse-circle", made; one of ``RECORDED``; or "real-" and a name of benchmarks.real.
        folder: for ``seed-source.npz``.
    """
    path = folder / f"{seed}-{source}.npz"
    if not path.exists():
        config = LoopConfig()
        if source in ("lidar", "stereo"):
            seen, world_from_cloud = observe_town(seed, source)
        elif source.startswith(REAL):
            seen, world_from_cloud, config = observe_real(source.removeprefix(REAL))
        else:
            seen, world_from_cloud = observe_clouds(clouds_of(seed, source), source)
        rows = np.array(list(_register(seen, world_from_cloud, config)))
        folder.mkdir(parents=True, exist_ok=True)
        count = len(FEATURES)
        np.savez(path, features=rows[:, :count], errors=rows[:, count:])
    with np.load(path) as stored:
        errors = stored["errors"] / limits_of(source)
        return Poses(stored["features"], errors, np.ones(len(errors)))


def limits_of(source: str) -> tuple[float, float]:
    """Metres and degrees that right poses are off at most."""
    if source.startswith(REAL):
        return RIGHT
    return METRES if source in ("lidar", "stereo", "sector") else ROOM_METRES, DEGREES


def observe_real(name: str) -> tuple[list[Observation], list[Matrix], LoopConfig]:
    """Observe a real recording as a detector does, local maps included; and how it is searched."""
    recording = read_real(data_folder(), name)
    if recording is None:
        raise SystemExit(f"{name} is not in {data_folder()}: FUSIONSLAM_TEST_DATA names the data")
    detector, recent = recording.detector(), RecentFrames()
    observer = FrameObserver(
        {recording.descriptor: recording.descriptor},
        detector.describe_config,
        detector.fusion_config,
        detector.registration_config,
        fits_lengths=True,
    ).verifying(detector.config.voters)
    seen: list[Observation] = []
    rows = zip(recording.clouds, recording.stamps_ns.tolist(), recording.odometry, strict=True)
    for number, (cloud, stamp, odometry) in enumerate(rows):
        found = observer.observe(
            cloud, stamp_ns=stamp, odometry=odometry, is_first=not seen, before=recent
        )
        seen.append(found)
        observer = observer.fixed_by(seen[0])
        found.add_to(recent, number)
    return seen, list(recording.poses), detector.config


def observe_town(seed: int, source: str) -> tuple[list[Observation], list[Matrix]]:
    """Observe the frames of a town's drive; return the poses of their clouds, too."""
    (drive,) = record_towns([seed])
    frames = open_dataset(drive)
    observer = FrameObserver(
        {"cm2dp": "cm2dp"},
        DescriptorConfig(),
        FusionConfig.model_validate({"source": source}),
        RegistrationConfig(),
        fits_lengths=True,
    )
    assert frames.poses is not None  # the simulator knows them
    return observe_all(observer, frames), [pose @ frames.body_from_points for pose in frames.poses]


def observe_clouds(
    clouds: Iterable[tuple[Cloud, Matrix]], source: str
) -> tuple[list[Observation], list[Matrix]]:
    """Observe clouds; return their poses, too. Those of hardly any points are left out."""
    known = [(cloud, pose) for cloud, pose in clouds if len(cloud) >= _FEWEST]
    observer = FrameObserver(
        {"m2dp": "m2dp"},
        DescriptorConfig() if source == "sector" else INDOORS,
        FusionConfig(source="cloud"),
        RegistrationConfig(local_map=0.0),
        fits_lengths=True,
    )
    return observe_all(observer, [cloud for cloud, _ in known]), [pose for _, pose in known]


_FEWEST = 10


def observe_all(
    observer: FrameObserver, frames_or_clouds: Iterable[Frame | Cloud]
) -> list[Observation]:
    """Observe clouds one by one; the first fixes lengths."""
    observer = observer.verifying(LoopConfig().voters)
    seen: list[Observation] = []
    for each in frames_or_clouds:
        seen.append(observer.observe(each, is_first=not seen))
        observer = observer.fixed_by(seen[0])
    return seen


def clouds_of(seed: int, source: str) -> Iterator[tuple[Cloud, Matrix]]:
    """Yield clouds and their poses, world_from_cloud: of a town's sector, a room or a recording."""
    if source == "sector":
        return cut_town(seed)
    if source in RECORDED:
        return read_recording(source.removeprefix("recorded-"))
    world, _, circle = source.partition("-")
    return scan_room(world, seed, CIRCLE_ROBOT if circle else ROBOT)


def cut_town(seed: int) -> Iterator[tuple[Cloud, Matrix]]:
    (drive,) = record_towns([seed])
    frames = open_dataset(drive)
    assert frames.poses is not None  # the simulator knows them
    for frame, pose in zip(frames, frames.poses, strict=True):
        points = frame.points
        assert points is not None
        ahead = np.abs(np.arctan2(points[:, 1], points[:, 0])) < SECTOR_RAD
        yield Cloud(np.ascontiguousarray(points[ahead])), pose @ frames.body_from_points


def scan_room(name: str, seed: int, robot_name: str) -> Iterator[tuple[Cloud, Matrix]]:
    """Drive through a made world, and scan it once a second, standing still."""
    robot = robot_named(robot_name)
    still = {"rate_hz": 1.0, "scan_motion": False}
    robot = merged(robot, {"lidars": {"velodyne": still}})
    lidar = robot.lidars["velodyne"]
    world = MADE[name].make(merged(MADE[name].settings, {"seed": seed}))
    plan = PlanConfig(seed=seed, spacing_m=8.0, again=0.2, back=0.2)
    world, drive = drive_through(world, robot, plan)
    config = SimulationConfig(seed=seed)
    events = simulate(
        world,
        robot,
        drive,
        config,
        select=lambda tasks: (task for task in tasks if task.topic == lidar.topic),
    )
    for event in events:
        assert isinstance(event.message, Scan)
        seconds = drive.seconds[0] + event.message.stamp_ns / NANOSECONDS - config.start_s
        (base,) = drive.at(np.array([seconds]))
        points = np.ascontiguousarray(event.message.points, np.float32)
        yield Cloud(points), base @ base_from(robot, lidar.frame_id)


def read_recording(name: str) -> Iterator[tuple[Cloud, Matrix]]:
    """Yield the coloured clouds of a recording, with the scanner at their origin."""
    recording = RangeRecording.open(data_folder() / "recordings" / f"{name}.npz")
    assert recording.poses is not None
    robot = robot_named(ROBOT)
    mounted = base_from(robot, robot.lidars["velodyne"].frame_id)
    for number, pose in enumerate(recording.poses):
        cloud = recording.whole_cloud(number)
        points = (cloud.points - mounted[:3, 3]).astype(np.float32)
        yield Cloud(points, cloud.colors), pose @ mounted


def _register(
    seen: Sequence[Observation], world_from_cloud: Sequence[Matrix], config: LoopConfig
) -> Iterator[Floats]:
    """Yield features, metres and degrees off of each registered pose."""
    clouds = [each.cloud for each in seen if each.cloud is not None]
    for query, matches in enumerate(_candidates(seen, config)):
        if query % STEP:
            continue
        cloud = clouds[query]
        found = [(each, k) for k in matches for each in search_poses(cloud, clouds[k])]
        found.sort(key=lambda pair: -pair[0].correlation)
        for hypothesis, match in found[:REGISTERED]:
            guess = hypothesis.pose
            result = register(cloud, clouds[match], guess, search=False, leveled=True)
            if result.estimate is None:
                continue
            truth = np.linalg.inv(world_from_cloud[match]) @ world_from_cloud[query]
            error = np.linalg.inv(truth) @ result.estimate
            turn = np.degrees(Rotation.from_matrix(error[:3, :3]).magnitude())
            colors = result.color_difference
            ratio = np.nan if colors is None else colors.ratio
            log_agreeing, degenerate = np.log(max(result.agreeing, 1)), len(result.degenerate)
            overlaps = result.overlap, result.mean_overlap
            features = *overlaps, ratio, log_agreeing, degenerate
            yield np.array([*features, np.linalg.norm(error[:3, 3]), turn])


def _candidates(seen: Sequence[Observation], config: LoopConfig) -> Iterator[set[int]]:
    """The nearest earlier frames of each frame by any of the descriptors."""
    metrics = {name: find_descriptor(name.split(",")[0]).metric for name in seen[0].vectors}
    memory = FrameMemory(metrics, config, RegistrationConfig())
    for number, each in enumerate(seen):
        found = memory.query(each.vectors, config.candidates, each.stamp_ns)
        yield {match for pairs in found.values() for match, _ in pairs}
        memory.add(number, replace(each, cloud=None))


def fit(features: Floats, right: Mask, weights: Floats) -> Floats:
    """Weighted logistic regression with a ridge on standardised features.

    Args:
        features: (N, F).
        right: (N,).
        weights: (N,).

    Returns:
        (1 + F,): intercept and slopes.
    """
    mean, sd = features.mean(axis=0), features.std(axis=0)
    scaled, shares = (features - mean) / sd, weights / weights.sum()

    def loss(slopes: Floats) -> tuple[float, Floats]:
        score = slopes[0] + scaled @ slopes[1:]
        costs = np.logaddexp(0, np.where(right, -score, score))
        excess = shares * (1 / (1 + np.exp(-score)) - right)
        penalty = RIDGE * np.r_[0, slopes[1:]]
        gradient = np.r_[excess.sum(), scaled.T @ excess] + penalty
        return float(shares @ costs + penalty @ slopes / 2), gradient

    found = minimize(loss, np.zeros(1 + features.shape[1]), jac=True, method="L-BFGS-B").x
    slopes = found[1:] / sd
    model: Floats = np.r_[found[0] - slopes @ mean, slopes]
    return model


def fit_models(drives: Mapping[str, Sequence[Poses]]) -> Models:
    """Fit each model.

    Overlaps of full circles make the plain one, poses that have colours the coloured one, and
    sectors and rooms the one of small views; real recordings of such clouds are among them.
    """
    towns = [*drives["lidar"], *drives["stereo"]]
    colored = joined(towns)
    known = np.isfinite(colored.of(["color_ratio"])[:, 0])
    colored = Poses(*(values[known] for values in colored))
    small = [poses for source in ("sector", *ROOMS, *CIRCLES) for poses in drives[source]]
    real = {
        kind: [poses for name in names for poses in drives[REAL + name]]
        for kind, names in REAL_FITTED.items()
    }
    sets = {
        "plain": joined([*drives["lidar"], *real["plain"]]),
        "colored": colored,
        "small": joined([*small, *real["small"]]),
    }
    return {
        kind: fit(poses.of(MODELS[kind]), poses.right, poses.weights)
        for kind, poses in sets.items()
    }


def predict(models: Models, poses: Poses, kinds: Sequence[str]) -> Floats:
    """The probability of each pose, by the first of some models that has all its features."""
    found: Floats = np.full(len(poses.errors), np.nan)
    for kind in kinds:
        model, features = models[kind], poses.of(MODELS[kind])
        rows = np.isnan(found) & np.isfinite(features).all(axis=1)
        found[rows] = 1 / (1 + np.exp(-model[0] - features[rows] @ model[1:]))
    return found


def model_yaml(models: Models) -> str:
    """Format the models as the package reads them."""
    lines = [
        "# SPDX-FileCopyrightText: 2026 The fusionslam authors",
        "# SPDX-License-Identifier: Apache-2.0",
        "# Logistic regression of right poses. Written by",
        "# python -m benchmarks.accuracy.registration_probability --write",
    ]
    for kind, model in models.items():
        names = ("intercept", *MODELS[kind])
        lines += [f"{kind}:"]
        lines += [f"  {name}: {value:.2f}" for name, value in zip(names, model, strict=True)]
    return "\n".join(lines) + "\n"


def calibration_row(said: Floats, poses: Poses) -> list[str]:
    """What was predicted of some poses, and what was right of it."""
    row = [str(len(said)), *(f"{within(poses.errors, *limits).mean():.1%}" for limits in LIMITS)]
    for low, high in itertools.pairwise(BINS):
        inside = (said >= low) & (said < high)
        right = poses.right[inside]
        row.append(f"{right.mean():.2f} ({len(right)})" if len(right) else "none")
    accepted = said >= LoopConfig().min_probability
    return [*row, f"{accepted[poses.right].mean():.2f}", count_wrong(said, poses)]


def count_wrong(said: Floats, poses: Poses) -> str:
    """Count the wrong ones of those that are probable enough for a loop."""
    accepted = said >= LoopConfig().min_probability
    return f"{(accepted & ~poses.right).sum()} of {accepted.sum()}"


def calibration_table(models: Models, folder: Path) -> str:
    """One row per kind of clouds, of drives that nothing was fitted to."""
    rows = []
    for name, (sources, kinds) in KINDS.items():
        poses = joined(
            [
                register_drive(seed, source, folder)
                for source in sources
                for seed in REPORTED[source]
            ]
        )
        cells = calibration_row(predict(models, poses, kinds), poses)
        plain = count_wrong(predict(models, poses, ["plain"]), poses)
        rows.append([name, f"`{kinds[0]}`", *cells, plain])
    least = LoopConfig().min_probability
    header = ["clouds", "model", "poses", *(f"off by up to {metres:g}" for metres, _ in LIMITS)]
    header += [f"{low:g} to {min(high, 1):g}" for low, high in itertools.pairwise(BINS)]
    header += [f"right ones with {least:g} or more", "wrong ones", "by `plain`"]
    return table(header, rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--poses", type=Path, default=cache_folder() / "judged-poses")
    arguments = parser.parse_args()
    drives = {
        source: [register_drive(seed, source, arguments.poses) for seed in seeds]
        for source, seeds in FITTED_TO.items()
    }
    model = model_yaml(fit_models(drives))
    # As the package reads them: rounded.
    models = {kind: np.array([*each.values()]) for kind, each in yaml.safe_load(model).items()}
    shown = calibration_table(models, arguments.poses)
    fitted, shown_seeds = (
        {source: ", ".join(map(str, seeds)) for source, seeds in chosen.items()}
        for chosen in (FITTED_TO, REPORTED)
    )
    recordings = {
        kind: " and ".join(f"`{name}`" for name in names) for kind, names in REAL_FITTED.items()
    }
    about = fill(
        "`python -m benchmarks.accuracy.registration_probability`: fitted to the towns of seeds "
        f"{fitted['lidar']}, and without colours to {recordings['plain']}; small views to sectors "
        f"in towns, houses and warehouses of {fitted['sector']}, to full circles in houses and "
        f"warehouses of {fitted[CIRCLES[0]]}, and to {recordings['small']}. "
        f"Shown are towns of {shown_seeds['lidar']}, sectors in towns of "
        f"{shown_seeds['sector']}, houses and warehouses of {shown_seeds[ROOMS[0]]}, "
        "and recordings that nothing was fitted to. Right poses are up to "
        f"{METRES:g} m, in rooms {ROOM_METRES:g} m, and {DEGREES:g} degrees off, of real "
        f"recordings {RIGHT[0]:g} m and {RIGHT[1]:g} degrees; beside "
        "their share stand those of 0.5 times as far and of 1.5 times as far with twice as many "
        "degrees. Columns from one probability to another: share of right poses (number of all) "
        "among those of which it was predicted. Wrong ones: of those with enough for a loop, and "
        "of those to which the overlap alone, by `plain`, gives enough.",
        100,
    )
    print(f"{about}\n\n{shown}\n\n{model}")
    if arguments.write:
        MODEL.write_text(model, encoding="utf-8")
        write_between(PAGE, "probability", f"{about}\n\n{shown}")


if __name__ == "__main__":
    main()
