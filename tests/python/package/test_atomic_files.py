# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A file is the old one or the new one, whatever happens, and nothing is left behind that grows.

At least FUSIONSLAM_KILLS writers are killed (30 by default), as many of each kind.
"""

import math
import os
import resource
import signal
import stat
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arrays import filled
from bags import drive as bag_drive
from bags import write_bag
from drives import circle_events, take
from error_codes import has_code
from fusionslam import DescriptorIndex, LoopDetector
from fusionslam.datasets import open_bag, read_cloud, write_cloud
from fusionslam.errors import DataError
from fusionslam.evaluation import DescriptorRun
from fusionslam.fusion import FusionConfig
from fusionslam.pipelines.export_folder import write_clouds
from fusionslam.pipelines.recording import Recording
from fusionslam.ratslam import RatSlam
from fusionslam.report.page.html import about_report, write_page
from fusionslam.sensors.frame import Cloud
from fusionslam.storage import files
from fusionslam.storage.archive import load_archive, load_json, save_archive, save_json
from fusionslam.storage.files import atomic_path, scratch_folder
from fusionslam.views import SceneSet, ViewMatcher
from kitti import write_sequence
from pages import Page
from scenes import LAPS, drive, place

KILLS = int(os.environ.get("FUSIONSLAM_KILLS", "30"))
FORMAT = "fusionslam.test.1"
ROWS = np.zeros(200_000)


def write(path: Path, text: str) -> None:
    with atomic_path(path) as temporary:
        temporary.write_text(text)


@contextmanager
def umask(mask: int) -> Iterator[None]:
    before = os.umask(mask)
    try:
        yield
    finally:
        os.umask(before)


def mode_of(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


@pytest.mark.parametrize(("mask", "mode"), [(0o022, 0o644), (0o077, 0o600), (0o002, 0o664)])
def test_a_new_file_has_the_mode_of_the_process(tmp_path: Path, mask: int, mode: int) -> None:
    with umask(mask):
        write(tmp_path / "a", "new")
    assert mode_of(tmp_path / "a") == mode


@pytest.mark.parametrize("mode", [0o600, 0o640, 0o664])
def test_a_file_that_is_written_again_keeps_its_mode(tmp_path: Path, mode: int) -> None:
    path = tmp_path / "a"
    path.write_text("old")
    path.chmod(mode)
    with atomic_path(path) as temporary:
        assert not mode_of(temporary) & ~mode
        temporary.write_text("new")
    assert (path.read_text(), mode_of(path)) == ("new", mode)


def test_a_link_is_kept_and_what_it_leads_to_is_replaced(tmp_path: Path) -> None:
    for folder in ("real", "links"):
        (tmp_path / folder).mkdir()
    (tmp_path / "real/a").write_text("old")
    (tmp_path / "links/a").symlink_to("../real/a")
    (tmp_path / "links/b").symlink_to("a")
    (tmp_path / "links/new").symlink_to("../real/new")
    for name in ("a", "b", "new"):
        write(tmp_path / "links" / name, name)
        assert (tmp_path / "links" / name).is_symlink()
        assert (tmp_path / "links" / name).read_text() == name
    assert sorted(os.listdir(tmp_path / "real")) == ["a", "new"]
    (tmp_path / "links/loop").symlink_to("loop")
    with pytest.raises(DataError, check=has_code("cannot-write")):
        write(tmp_path / "links/loop", "no")


def test_the_name_of_a_temporary_file_cannot_be_guessed_or_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with atomic_path(tmp_path / "a") as one, atomic_path(tmp_path / "a") as other:
        assert one != other
    victim = tmp_path / "victim"
    victim.write_text("kept")
    monkeypatch.setattr(files.secrets, "token_hex", lambda _: "0" * 16)
    with atomic_path(tmp_path / "a") as temporary:
        planted = temporary
    planted.symlink_to(victim)
    with pytest.raises(DataError, check=has_code("cannot-write")):
        write(tmp_path / "a", "over")
    assert victim.read_text() == "kept"


def test_long_names_are_written(tmp_path: Path) -> None:
    name = "\N{CJK UNIFIED IDEOGRAPH-4E00}" * 85
    write(tmp_path / name, "x")
    assert os.listdir(tmp_path) == [name]


def killed(work: Callable[[], Any], seconds: float) -> None:
    """Do work again and again in a child, which is killed after some time."""
    child = os.fork()
    if not child:
        try:
            while True:
                work()
        finally:
            os._exit(1)
    time.sleep(seconds)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)


def test_what_killed_writers_leave_is_deleted_by_the_next(tmp_path: Path) -> None:
    def begin() -> None:
        with atomic_path(tmp_path / "a") as temporary, scratch_folder(tmp_path / "b") as folder:
            (folder / "part").write_text("x")
            temporary.with_name(f"{temporary.name}.7.0.tmp").write_text("of the C++ core")
            time.sleep(1000)

    others = (".hidden", ".a.fusionslam-00000000-1-0123456789abcdef", "a.fusionslam")
    for name in others:
        (tmp_path / name).write_text("of others")
    killed(begin, 0.3)
    assert len(os.listdir(tmp_path)) == 6
    with atomic_path(tmp_path / "c") as alive:
        write(tmp_path / "a", "new")
        assert alive.exists()
        alive.write_text("c")
    assert sorted(os.listdir(tmp_path)) == sorted([*others, "a", "c"])


def test_old_leftovers_of_other_machines_are_deleted(tmp_path: Path) -> None:
    left = tmp_path / ".a.fusionslam-00000000-1-0123456789abcdef"
    left.write_text("old")
    os.utime(left, (0, 0))
    write(tmp_path / "a", "new")
    assert os.listdir(tmp_path) == ["a"]


def check_archive(folder: Path) -> None:
    with load_archive(folder / "a.npz", FORMAT, "a test") as (_, arrays):
        assert len(arrays["rows"]) == len(ROWS)


def check_json(folder: Path) -> None:
    with load_json(folder / "a.json", FORMAT, "a test") as content:
        assert len(content["numbers"]) == 20_000


def detector() -> LoopDetector:
    made = LoopDetector("m2dp")
    for number in range(40):
        made.add(Cloud(place(number % 5).points))
    return made


def slam() -> RatSlam:
    made = RatSlam()
    take(made, circle_events(laps=0.5))
    return made


def matcher() -> ViewMatcher:
    made = ViewMatcher()
    for number in range(12):
        made.process(place(number % 5))
    return made


def write_drive(folder: Path) -> None:
    write_bag(folder / "drive.mcap", bag_drive(0.5))


def read_drive(folder: Path) -> None:
    with open_bag(folder / "drive.mcap") as bag:
        assert bag.topics


def descriptor_run() -> DescriptorRun:
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


def write_report(folder: Path) -> None:
    notes = ["a note of this report"] * 5_000
    write_page(folder / "a.html", "page.html.j2", ABOUT, title="a test", notes=notes)


def check_report(folder: Path) -> None:
    text = (folder / "a.html").read_text()
    Page(text)
    assert text.count("a note") == 5_000 and text.rstrip().endswith("</html>")


DETECTOR, SLAM, MATCHER, SCENES, INDEX = detector(), slam(), matcher(), drive(LAPS), filled(500)
CLOUD, RUN = Cloud(np.ones((20_000, 3), np.float32)), descriptor_run()
ABOUT = about_report("a test", "fusionslam", {})
WRITERS: dict[str, tuple[Callable[[Path], Any], Callable[[Path], Any], int]] = {
    "archive": (
        lambda folder: save_archive(folder / "a.npz", FORMAT, {}, {"rows": ROWS}),
        check_archive,
        1,
    ),
    "JSON": (
        lambda folder: save_json(folder / "a.json", FORMAT, {"numbers": [0.5] * 20_000}),
        check_json,
        1,
    ),
    "loop detector": (DETECTOR.save, LoopDetector.load, 1),
    "RatSlam": (lambda at: SLAM.save(at / "a"), lambda at: RatSlam.load(at / "a"), 1),
    "view matcher": (lambda at: MATCHER.save(at / "a"), lambda at: ViewMatcher.load(at / "a"), 1),
    "scene set": (lambda at: SCENES.save(at / "a.npz"), lambda at: SceneSet.load(at / "a.npz"), 1),
    "index": (lambda at: INDEX.save(at / "a"), lambda at: DescriptorIndex.load(at / "a"), 1),
    "cloud": (lambda at: write_cloud(at / "a.ply", CLOUD), lambda at: read_cloud(at / "a.ply"), 1),
    "bag": (write_drive, read_drive, 1),
    "descriptor run": (
        lambda at: RUN.save(at / "a.npz"),
        lambda at: DescriptorRun.load(at / "a.npz"),
        1,
    ),
    "page of a report": (write_report, check_report, 1),
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_killed_writer_leaves_the_old_or_the_new_file(tmp_path: Path, name: str) -> None:
    save, check, count = WRITERS[name]
    save(tmp_path)
    rng = np.random.default_rng(2)
    for _ in range(math.ceil(KILLS / len(WRITERS))):
        killed(lambda: save(tmp_path), float(rng.uniform(0.002, 0.05)))
        check(tmp_path)
    files._cleaned.clear()
    save(tmp_path)
    assert len(os.listdir(tmp_path)) == count


def test_a_killed_fuse_leaves_whole_clouds_and_the_next_completes_them(tmp_path: Path) -> None:
    sequence = write_sequence(tmp_path, [0, 1, 2, 3] * 5, [4000] * 20, metres=3, width=64)
    recording = Recording.at(sequence)

    def write(folder: Path, last: int = -1) -> None:
        def kill(done: int, _: int) -> None:
            if done == last:
                os.kill(os.getpid(), signal.SIGKILL)

        write_clouds(recording, folder, FusionConfig(), jobs=2, progress=kill)

    def clouds(folder: Path) -> dict[str, bytes]:
        return {path.name: path.read_bytes() for path in (folder / "clouds").iterdir()}

    write(tmp_path / "whole")
    whole, names = clouds(tmp_path / "whole"), sorted(os.listdir(tmp_path / "whole"))
    for last in np.linspace(1, 19, math.ceil(KILLS / len(WRITERS))).astype(int):
        folder = tmp_path / str(last)
        child = os.fork()
        if not child:
            write(folder, last)
            os._exit(0)
        assert os.WTERMSIG(os.waitpid(child, 0)[1]) == signal.SIGKILL
        found = {name: data for name, data in clouds(folder).items() if name[0] != "."}
        assert len(found) >= last and found.items() <= whole.items()
        files._cleaned.clear()
        write(folder)
        assert clouds(folder) == whole and sorted(os.listdir(folder)) == names


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("share", [0.0, 0.1, 0.9])
def test_a_full_disk_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, name: str, share: float
) -> None:
    save, check, count = WRITERS[name]
    save(tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    room = int(share * max(map(len, before.values())))
    child = os.fork()
    if not child:
        code = 1
        try:
            resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))
            save(tmp_path)
        except DataError as error:
            code = int(error.code != "cannot-write")
        finally:
            os._exit(code)
    _, status = os.waitpid(child, 0)
    assert os.waitstatus_to_exitcode(status) == 0
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    check(tmp_path)
    assert len(before) == count
