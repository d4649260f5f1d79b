# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Kills writers with SIGKILL and counts what they lose: ``python -m fuzz.killed_writers --write``.

A writer saves the same file again and again. After a kill the old or the new file must be there,
and the next save must leave nothing else behind. A map grows instead: after a kill it must be
whole, with every keyframe that was acknowledged, and the session goes on.
"""

import os
import signal
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from arrays import filled
from bags import drive as bag_drive
from bags import write_bag
from benchmarks.accuracy.markdown import read_rows, table, write_between
from drives import circle_events, take
from fusionslam import DescriptorIndex, LoopDetector
from fusionslam.base import files
from fusionslam.base.archive import load_archive, load_json, save_archive, save_json
from fusionslam.datasets import open_bag, read_cloud, write_cloud
from fusionslam.errors import DataError
from fusionslam.evaluation import DescriptorRun
from fusionslam.mapping.place_map import PlaceMap
from fusionslam.ratslam import RatSlam
from fusionslam.report.page.html import about_report, write_page
from fusionslam.sensors.frame import Cloud, Frame
from fusionslam.views import SceneSet, ViewMatcher
from fuzz.results import PAGE
from pages import Page
from scenes import LAPS, drive, place
from streets import OPTIONS, WAY, frames

FORMAT = "fusionslam.test.1"
ROWS = np.zeros(200_000)
FILES_KILLED_AFTER_S = (0.002, 0.05)
"""Most saves take some milliseconds."""
MAP_KILLED_AFTER_S = (0.005, 0.5)
"""A map opens in 10 ms to 30 ms, and takes a keyframe in about 90 ms."""
MOST_KEYFRAMES = 40


@dataclass(frozen=True)
class Writer:
    """Saves one file in a folder.

    Attributes:
        save: writes the file.
        check: reads it. Raises DataError or AssertionError if it is not whole.
        killed_after: when it is killed, in seconds after it began: at least, and at most.
    """

    save: Callable[[Path], object]
    check: Callable[[Path], object]
    killed_after: tuple[float, float] = FILES_KILLED_AFTER_S


@dataclass(frozen=True)
class KillCount:
    """Numbers of kills, of files lost by them, and of files that the next save left behind."""

    kills: int
    lost: int
    left: int


def kill_writer(writer: Writer, folder: Path, kills: int, seed: int = 2) -> KillCount:
    """Kill a writer at random times; ``folder`` must be empty."""
    writer.save(folder)
    files_of_one_save = set(os.listdir(folder))
    rng = np.random.default_rng(seed)
    lost = 0
    for _ in range(kills):
        kill_after(lambda: writer.save(folder), float(rng.uniform(*writer.killed_after)))
        lost += _is_lost(writer, folder)
    files._cleaned.clear()  # this process looks for leftovers once per folder
    writer.save(folder)
    return KillCount(kills, lost, len(set(os.listdir(folder)) - files_of_one_save))


def kill_after(work: Callable[[], object], seconds: float) -> None:
    """Do work again and again in a child process, which is killed after some time."""
    child = os.fork()
    if not child:
        try:
            while True:
                work()
        finally:
            os._exit(1)
    time.sleep(seconds)
    os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    if not os.WIFSIGNALED(status):
        raise RuntimeError("the writer ended by itself before it was killed")


def _is_lost(writer: Writer, folder: Path) -> bool:
    try:
        writer.check(folder)
    except (AssertionError, DataError):
        return True
    return False


def _check_archive(folder: Path) -> None:
    with load_archive(folder / "a.npz", FORMAT, "a test") as (_, stored):
        assert len(stored["rows"]) == len(ROWS)


def _check_json(folder: Path) -> None:
    with load_json(folder / "a.json", FORMAT, "a test") as content:
        assert len(content["numbers"]) == 20_000


def _detector() -> LoopDetector:
    made = LoopDetector("m2dp")
    for number in range(40):
        made.add(Cloud(place(number % 5).points))
    return made


def _slam() -> RatSlam:
    made = RatSlam()
    take(made, circle_events(laps=0.5))
    return made


def _matcher() -> ViewMatcher:
    made = ViewMatcher()
    for number in range(12):
        made.process(place(number % 5))
    return made


def _check_drive(folder: Path) -> None:
    with open_bag(folder / "drive.mcap") as bag:
        assert bag.topics


def _descriptor_run() -> DescriptorRun:
    count = 300
    return DescriptorRun(
        source="lidar",
        descriptor="m2dp",
        dataset="a test",
        descriptors=np.ones((count, 192), np.float32),
        frames=np.arange(count),
        stamps_ns=np.arange(count),
        poses=np.tile(np.eye(4), (count, 1, 1)),
        seconds={"describe": np.ones(count)},
        peak_memory_bytes=1,
        points=np.ones(count, np.int64),
    )


def _write_report(folder: Path) -> None:
    notes = ["a note of this report"] * 5_000
    write_page(folder / "a.html", "page.html.j2", ABOUT, title="a test", notes=notes)


def _check_report(folder: Path) -> None:
    text = (folder / "a.html").read_text()
    Page(text)
    assert text.count("a note") == 5_000 and text.rstrip().endswith("</html>")


ACKNOWLEDGED = "acknowledged"


def add_to_map(folder: Path) -> None:
    """Go on with the session of a map; note the frame of every keyframe that it acknowledges."""
    noted = os.open(folder / ACKNOWLEDGED, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600)
    with PlaceMap.open(folder / "a.fsmap", "drive", **OPTIONS) as site:
        first = 0 if site.last_frame is None else site.last_frame + 1
        for number in range(first, first + 3):
            seen = street_frames()[number % len(WAY)]
            frame = Frame(index=number, points=seen.points, odometry=seen.odometry)
            if site.add(frame).keyframe is not None:
                os.write(noted, f"{number}\n".encode())
    os.close(noted)


def check_map(folder: Path) -> None:
    """The map is whole and has all that it acknowledged; a long one forgets what it has."""
    noted = folder / ACKNOWLEDGED
    path = folder / "a.fsmap"
    with PlaceMap.open(path, read_only=True) as site:
        assert site.check() == []
        kept = site.frames("drive").tolist() if site.sessions else []
        assert {int(line) for line in noted.read_text().split()} <= {*kept}
        assert len({*kept}) == len(kept) == len(site)
        if site.sessions:
            assert np.isfinite(site.trajectory("drive")[1]).all()
    if len(kept) > MOST_KEYFRAMES:
        with PlaceMap.open(path) as site:
            site.forget("drive")
        noted.write_text("")


@cache
def street_frames() -> list[Frame]:
    """The frames of a drive up and down a street, which closes loops."""
    return frames(WAY)


DETECTOR, SLAM, MATCHER, SCENES, INDEX = _detector(), _slam(), _matcher(), drive(LAPS), filled(500)
CLOUD, RUN = Cloud(np.ones((20_000, 3), np.float32)), _descriptor_run()
ABOUT = about_report("a test", "fusionslam", {})
REPLACING = {
    "archive": Writer(
        lambda at: save_archive(at / "a.npz", FORMAT, {}, {"rows": ROWS}), _check_archive
    ),
    "JSON": Writer(
        lambda at: save_json(at / "a.json", FORMAT, {"numbers": [0.5] * 20_000}), _check_json
    ),
    "loop detector": Writer(DETECTOR.save, LoopDetector.load),
    "RatSlam": Writer(lambda at: SLAM.save(at / "a"), lambda at: RatSlam.load(at / "a")),
    "view matcher": Writer(
        lambda at: MATCHER.save(at / "a"), lambda at: ViewMatcher.load(at / "a")
    ),
    "scene set": Writer(
        lambda at: SCENES.save(at / "a.npz"), lambda at: SceneSet.load(at / "a.npz")
    ),
    "index": Writer(lambda at: INDEX.save(at / "a"), lambda at: DescriptorIndex.load(at / "a")),
    "cloud": Writer(
        lambda at: write_cloud(at / "a.ply", CLOUD), lambda at: read_cloud(at / "a.ply")
    ),
    "bag": Writer(lambda at: write_bag(at / "drive.mcap", bag_drive(0.5)), _check_drive),
    "descriptor run": Writer(
        lambda at: RUN.save(at / "a.npz"), lambda at: DescriptorRun.load(at / "a.npz")
    ),
    "page of a report": Writer(_write_report, _check_report),
}
"""Writers that put a new file in the place of the old one."""
WRITERS = REPLACING | {"map": Writer(add_to_map, check_map, MAP_KILLED_AFTER_S)}


def main(
    kills: Annotated[int, typer.Option(min=1, help="Kills of each writer.")] = 112,
    writer: Annotated[list[str] | None, typer.Option(help="Writer; default: all.")] = None,
    write: Annotated[
        bool, typer.Option("--write", help="Write the table of docs/results/robustness.md.")
    ] = False,
) -> None:
    """Kill writers; ends with 1 if a file is lost or left behind."""
    counts: dict[str, KillCount] = {}
    for name in writer or WRITERS:
        with tempfile.TemporaryDirectory() as folder:
            counts[name] = kill_writer(WRITERS[name], Path(folder), kills)
            print(name, counts[name])
    if write:
        write_between(PAGE, "kills", _table(counts))
    raise typer.Exit(1 if any(count.lost or count.left for count in counts.values()) else 0)


_COLUMNS = ("kills", "files lost", "files left behind after the next save")


def _table(counts: Mapping[str, KillCount]) -> str:
    """One row a writer, and the sums; rows of writers that were not killed stay."""
    stored = read_rows(PAGE, "kills")[:-1]
    rows = {name: [int(cell.replace(",", "")) for cell in cells] for name, *cells in stored}
    rows |= {name: [count.kills, count.lost, count.left] for name, count in counts.items()}
    rows["all"] = [sum(column) for column in zip(*rows.values(), strict=True)]
    cells = [[name, *(f"{value:,}" for value in values)] for name, values in rows.items()]
    return table(["writer", *_COLUMNS], cells)


if __name__ == "__main__":
    typer.run(main)
