# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How good are maps of rooms, and is a robot found on them? Markdown tables.

python -m benchmarks.accuracy.room_maps            # worlds that nothing was fitted to
python -m benchmarks.accuracy.room_maps house 6 7  # one world of these seeds
python -m benchmarks.accuracy.room_maps --write    # and put the tables into the docs

The recordings need the test data, which FUSIONSLAM_TEST_DATA names. A made world takes two to four
minutes of processor time. Maps are kept in the cache; ``--fresh`` makes them anew, as after a
change of ``fusionslam.mapping``.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from textwrap import fill
from typing import NamedTuple

import numpy as np

from benchmarks.accuracy.data import WORLDS, data_folder
from benchmarks.accuracy.mapped_drives import (
    GOOD,
    NEAR,
    SESSION,
    SHARES,
    STRIDE,
    Frames,
    MappedDrive,
    Shares,
)
from benchmarks.accuracy.markdown import table, write_between
from benchmarks.accuracy.pose_graphs import ate
from benchmarks.accuracy.presets import ROOT, mean_and_range
from benchmarks.accuracy.recorded_loops import CONFIG
from benchmarks.accuracy.rooms import CIRCLE_ROBOT, RecordedDrive, RoomDrive
from fusionslam import FusionConfig
from fusionslam.base.cache import cache_folder
from fusionslam.geometry.odometry_noise import OdometryConfig
from fusionslam.mapping.config import MapConfig
from fusionslam.mapping.place_map import PlaceMap
from fusionslam.registration import RegistrationConfig

PAGE = ROOT / "docs" / "stages" / "mapping.md"
DRIFT = OdometryConfig(scale=1.02, rotation_scale=1.01)
NOISE = OdometryConfig(scale=1.02, rotation_scale=1.01, turn_noise=0.01)
SEEDS = {"house": (7, 8, 9), "warehouse": (7, 8, 9), "hospital": (7,)}
"""Nothing was fitted to them; that a floor is level was stated after looking at house 6."""
BOUNDS = {"hospital": 0.15}
BOUND = 0.10
"""Of the ATE, metres."""
RIGHT = (0.3, 5.0)
"""Metres and degrees beyond which a loop is false."""
FLOOR = {"drift_height": 0.003, "drift_tilt": 0.0005}
"""Drift of a robot on a level floor: a tenth of the defaults."""
APART = 0.3
"""Metres between keyframes of the recordings: planar registration takes views up to 0.6 m apart."""
HEAD = ["world", "seed", "m", "keyframes", "ATE of odometry, m", "ATE, m", "bound", "believed"]
HEAD += ["false ones of them", "refused", "right ones of them", "s a keyframe, median", "95 %"]
PART = 0.4
"""Of a recording that is mapped; the rest is localised."""
VIEW = (0.6, 20.0)
"""Metres and degrees that views of a sector may be apart for planar registration."""
NOISE_SEED = 100
"""Added to the seed, for the noise of the second drive."""


class Room(NamedTuple):
    """A map of a world, and the length of the way."""

    name: str
    seed: str
    mapped: MappedDrive
    metres: float


def map_room(name: str, seed: int, folder: Path) -> Room:
    """Map a drive through a made world."""
    drive = RoomDrive(name, seed)
    mapped = MappedDrive(
        folder / f"{name}-{seed}",
        drive.true,
        drive.odometry(DRIFT),
        drive.frames,
        descriptor="m2dp",
        fusion=FusionConfig(source="cloud"),
        config=MapConfig.model_validate({"drift": FLOOR}),
    )
    return Room(name, str(seed), mapped, drive.metres)


def map_recording(name: str, folder: Path, errors: OdometryConfig) -> Room:
    """Map a recording with odometry that has these errors."""
    drive = RecordedDrive(name)
    noisy = errors == NOISE
    path = folder / f"recorded-{name}{'-noise' if noisy else ''}"
    mapped = map_sectors(path, drive, errors, drive.frames)
    return Room(f"recorded {name}{', noise' if noisy else ''}", "", mapped, drive.metres)


def map_sectors(
    path: Path,
    drive: RecordedDrive,
    errors: OdometryConfig,
    frames: Frames,
    session: str = SESSION,
    registration: RegistrationConfig = CONFIG.registration,
) -> MappedDrive:
    """Map frames of a recording by planar registration."""
    return MappedDrive(
        path,
        drive.true,
        drive.odometry(errors),
        frames,
        session,
        loops=CONFIG.loop_closure,
        fusion=CONFIG.fusion,
        registration=registration,
        config=MapConfig(keyframe_distance=APART),
    )


def map_part(name: str, folder: Path, like: MappedDrive | None = None) -> MappedDrive:
    """Map the first part of a recording; or what follows, with the lengths of another map.

    Lengths are fitted to the first cloud of a map; maps with other ones cannot be merged.
    """
    drive = RecordedDrive(name)
    end = round(PART * len(drive.true))
    rest = like is not None
    path = folder / f"recorded-{name}-{'rest' if rest else 'part'}"
    lengths = CONFIG.registration
    if like is not None:
        with PlaceMap.open(like.path, read_only=True) as site:
            lengths = site.settings.registration
    return map_sectors(
        path,
        drive,
        DRIFT,
        lambda: (frame for frame in drive.frames() if (frame.number >= end) == rest),
        "rest" if rest else SESSION,
        lengths,
    )


def split_recording(name: str, folder: Path) -> Shares:
    """Map the first part of a recording, and localise the rest on it."""
    drive = RecordedDrive(name)
    end = round(PART * len(drive.true))
    rest = map_part(name, folder).localize(
        "rest",
        lambda: (frame for frame in drive.frames() if frame.number >= end),
        drive.true,
        stride=1,
        view=VIEW[1],
    )
    return Shares(rest, VIEW[0])


def row(room: Room) -> list[str]:
    """What a map believes, and how far off it is."""
    mapped = room.mapped
    believed = [edge for edge in mapped.loops if edge.state == "believed"]
    refused = [edge for edge in mapped.loops if edge.state != "believed"]
    false, wrong = (sum(mapped.is_false(e, RIGHT) for e in some) for some in (believed, refused))
    median, late = np.percentile(mapped.seconds, [50, 95])
    errors = errors_of(mapped)
    return [
        *(room.name, room.seed, f"{room.metres:.0f}", str(len(mapped.frames))),
        *(f"{errors[0]:.2f}", f"{errors[1]:.3f}", f"{BOUNDS.get(room.name, BOUND):.2f}"),
        *(str(len(believed)), str(false), str(len(refused)), str(len(refused) - wrong)),
        *(f"{median:.2f}", f"{late:.2f}"),
    ]


def errors_of(mapped: MappedDrive) -> list[float]:
    """ATE of odometry and of the map, metres."""
    odometry = mapped.odometry[mapped.frames]
    return [ate(poses, mapped.true_keyframes) for poses in (odometry, mapped.poses)]


def maps_text() -> str:
    level = " and ".join(f"{key} {value:g}" for key, value in FLOOR.items())
    return fill(
        f"Made worlds, the full circle of `{CIRCLE_ROBOT}`, one scan a second, defaults but for "
        f"{level}: the floor is level. Recordings of another simulator: a sector with colours at "
        f"2 Hz, planar registration, a keyframe each {APART:g} m. Odometry is the truth with "
        f"distances {100 * (DRIFT.scale - 1):.0f} % too long and turns "
        f"{100 * (DRIFT.rotation_scale - 1):.0f} % too large; in the rows with noise its heading "
        f"has noise of {NOISE.turn_noise:g} rad after one second, too, for which no bound was set. "
        f"A loop is false if it is more than {RIGHT[0]:g} m or {RIGHT[1]:g} degrees off. Nothing "
        "was fitted to these seeds.",
        100,
    )


def maps_table(worlds: dict[str, Sequence[int]], folder: Path) -> str:
    """Errors of the maps, what they believe, and what they cost."""
    rows = []
    for name, seeds in worlds.items():
        rooms = [map_room(name, seed, folder) for seed in seeds]
        rows += [row(room) for room in rooms]
        means = [mean_and_range(v) for v in np.array([errors_of(room.mapped) for room in rooms]).T]
        rows.append([name, "mean (range)", "", "", *means, *[""] * 7])
    data_folder()
    for errors in (DRIFT, NOISE):
        rows += [row(map_recording(name, folder, errors)) for name in WORLDS]
    return table(HEAD, rows)


def fixes_text() -> str:
    return fill(
        "A second drive through the houses: the same way in the opposite direction, with other "
        f"noise. Each {STRIDE}th frame is localised, without any guess and without odometry. "
        f"Found: of the frames at most {NEAR:g} m from a keyframe. Good: within {GOOD[0]:g} m and "
        f"{GOOD[1]:g} degrees of the truth. Of the recordings, in which there is one drive each, "
        f"{100 * PART:g} % are mapped and all frames of the rest localised; near is up to "
        f"{VIEW[0]:g} m and {VIEW[1]:g} degrees from a keyframe, as a sector shows something else "
        "to a robot that looks elsewhere.",
        100,
    )


def fixes_table(seeds: Sequence[int], folder: Path) -> str:
    """What is found on the maps of houses."""
    rows, shares = [], []
    for seed in seeds:
        mapped = map_room("house", seed, folder).mapped
        back = RoomDrive("house", seed, noise=seed + NOISE_SEED, back=True)
        own = Shares(mapped.localize(f"house-{seed}-back", back.frames, back.true))
        shares.append([own.found, own.good])
        rows.append([f"house {seed}", *own.cells()])
    ranges = [mean_and_range(values) for values in np.array(shares).T]
    rows.append(["house, mean (range)", "", *ranges, *[""] * 5])
    rows += [[f"recorded {name}", *split_recording(name, folder).cells()] for name in WORLDS]
    return table(["map", *SHARES], rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("world", nargs="?", choices=SEEDS)
    parser.add_argument("seeds", nargs="*", type=int)
    parser.add_argument("--write", action="store_true", help="put the tables into the docs")
    parser.add_argument("--fresh", action="store_true", help="use nothing of earlier runs")
    arguments = parser.parse_args()
    worlds: dict[str, Sequence[int]] = dict(SEEDS)
    if arguments.world:
        worlds = {arguments.world: arguments.seeds or SEEDS[arguments.world]}
    folder = cache_folder() / "room-maps"
    folder.mkdir(parents=True, exist_ok=True)
    if arguments.fresh:
        for path in folder.iterdir():
            path.unlink()
    texts = {"room maps": f"{maps_text()}\n\n{maps_table(worlds, folder)}"}
    if "house" in worlds:
        found = fixes_table(worlds["house"], folder)
        texts["house localization"] = f"{fixes_text()}\n\n{found}"
    print("\n\n".join(texts.values()))
    if arguments.write:
        for name, text in texts.items():
            write_between(PAGE, name, text)


if __name__ == "__main__":
    main()
