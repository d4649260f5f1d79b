# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Place recognition, loops, maps and localisation on real recordings. Markdown tables.

python -m benchmarks.real                        # every recording that is there
python -m benchmarks.real hku_1                  # this one
python -m benchmarks.real hku_1 --without-peers  # without MapClosures and KISS-SLAM's closer
python -m benchmarks.real --write                # and put the tables into the docs
python -m benchmarks.real --tilted --write       # instead: level sensors that are tilted

The recordings are part of the test data, which FUSIONSLAM_TEST_DATA names. Rows of recordings that
are not measured stay as they are in the docs. The peers run in the environment of
``benchmarks.accuracy.loop_peers``; without it the program says so and goes on.
"""

import argparse
import itertools
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.accuracy.data import ROOT, find_folder
from benchmarks.accuracy.loop_peers import (
    OURS,
    note,
    peers_of,
    peers_python,
    run_detector,
    run_peers,
)
from benchmarks.accuracy.mapped_drives import MappedDrive
from benchmarks.accuracy.markdown import read_rows, table, write_between
from benchmarks.accuracy.pose_graphs import ate
from benchmarks.real.plain import can_describe, join, recognise, recognise_all
from benchmarks.real.protocol import (
    BINS,
    RIGHT,
    count_right,
    find_older,
    find_revisits,
    judge,
    spread,
)
from benchmarks.real.recordings import (
    MAPPED,
    READERS,
    SECOND,
    Recording,
    make_house,
    read_recording,
)
from fusionslam.evaluation import VerifiedRun

PAGE = ROOT / "docs" / "results" / "real.md"
README = ROOT / "README.md"
PICTURE = ROOT / "docs" / "images" / "real_reliability.png"
PLAIN, UNPROVEN = "scan_context", "Scan Context, without proof"
QUOTED = (OURS, *peers_of(10))
"""Those whose loops the README shows; of peers with their longest local maps."""
LOOPS = (
    *("recording", "found by", "frames", "revisits", "recall of the accepted"),
    *("recall at full precision", "accepted", "wrong", "error: median, m", "95 %, m", "ms a frame"),
)
MAPS = (
    *("recording", "frames", "keyframes", "parts", "ATE of odometry, m", "ATE, m", "believed"),
    *("false ones of them", "refused", "ms a keyframe"),
)
FIXES = (
    *("recording", "frames are asked", "map of", "frames", "found", "within 0.5 m"),
    *("beyond 1 m", "error: median, m", "95 %, m", "ms a frame"),
)
DESCRIPTORS = ("descriptor", "top-1", "one of ten", "F1max", "R@100P", "ms a frame")
TILTED, HOUSE = ("hku_1", "hku_2", "kitti_bev_06"), 7
"""Recordings, and seed of a made house, that are tilted."""
TILTS_DEG = (0, 5, 15, 30, 45)
TILTS = ("recording", "tilted by", "odometry", *LOOPS[4:9])
RELIABILITY = ("recording", *(f"{low:g} to {high:g}" for low, high in itertools.pairwise(BINS)))
FITTED = ("kitti_bev_05", "kitti00_keyframes", "hku_1", "balm_realworld")
"""Recordings that probabilities are fitted to (benchmarks.accuracy.registration_probability)."""
Row = list[str]


def prove_loops(recording: Recording) -> VerifiedRun:
    return run_detector(
        recording.detector(),
        recording.clouds,
        recording.poses,
        stamps_ns=recording.stamps_ns,
        odometry=recording.odometry,
    )


def find_loops(recording: Recording, run: VerifiedRun, python: Path | None) -> Iterator[Row]:
    """Yield a row for each of those that find loops: ours, the peers, Scan Context alone."""
    clouds, poses, stamps = recording.clouds, recording.poses, recording.stamps_ns
    rule, odometry = recording.rule, recording.odometry
    ours = judge(run, rule)
    yield [recording.name, OURS, *ours.cells()]
    if python is not None:
        older = find_older(stamps, rule).sum(axis=1)
        # Noise on made odometry must not bend their local maps.
        path = poses if recording.recorded_odometry is None else odometry
        for scans, peer in run_peers(python, clouds, path, older, recording.joined):
            found = judge(replace(peer, poses=poses, stamps_ns=stamps), rule)
            yield [recording.name, f"{peer.descriptor} of {scans}", *found.cells()]
    if ours.revisits and can_describe(recording, PLAIN):
        *_, full, milliseconds = recognise(recording, PLAIN).cells()
        counts = [str(ours.frames), str(ours.revisits)]
        unproven = [*counts, "-", full, *"----", milliseconds]
        yield [recording.name, UNPROVEN, *unproven]


def tilt_sensors(data: Path) -> Iterator[Row]:
    """Yield a row for each tilt of each recording, with odometry, and for full circles without."""
    found = [read_recording(data, name) for name in TILTED]
    for recording in [*(each for each in found if each is not None), make_house(HOUSE)]:
        ways = (True,) if recording.name in SECOND or recording.name in MAPPED else (True, False)
        for degrees, is_known in itertools.product(TILTS_DEG, ways):
            note(f"{recording.name}, tilted by {degrees} degrees")
            tilted = recording.tilted(degrees)
            run = run_detector(
                tilted.detector(),
                tilted.clouds,
                tilted.poses,
                stamps_ns=tilted.stamps_ns,
                odometry=tilted.odometry if is_known else None,
            )
            cells = judge(run, tilted.rule).cells()[2:7]
            yield [recording.name, f"{degrees}", "known" if is_known else "none", *cells]


def make_map(recording: Recording, folder: Path) -> MappedDrive:
    return MappedDrive(
        folder / recording.name,
        recording.poses,
        recording.odometry,
        recording.frames,
        session=recording.name,
        descriptor=recording.descriptor,
        **recording.options(),
    )


def judge_map(recording: Recording, mapped: MappedDrive) -> Row:
    odometry = mapped.odometry[mapped.frames]
    ates = [ate(poses, mapped.true_keyframes) for poses in (odometry, mapped.poses)]
    believed = [edge for edge in mapped.loops if edge.state == "believed"]
    counts = [len(recording.clouds), len(mapped.frames), mapped.parts]
    loops = [len(believed), sum(mapped.is_false(edge, RIGHT) for edge in believed)]
    return [
        recording.name,
        *map(str, counts),
        *(f"{value:.3f}" for value in ates),
        *map(str, [*loops, len(mapped.loops) - len(believed)]),
        f"{np.mean(mapped.seconds) * 1e3:.0f}",
    ]


def localize(second: Recording, first: Recording, mapped: MappedDrive) -> Iterator[Row]:
    """Yield a row for frames that are asked alone, and one for those of a robot that goes on."""
    for asked, alone in (("alone", True), ("one after the other", False)):
        fixes = mapped.localize(asked, second.frames, second.poses, stride=1, alone=alone)
        errors = np.array([fix.error for fix in fixes if fix.error is not None])
        counts = [len(fixes), len(errors), (errors <= 0.5).sum(), (errors > 1.0).sum()]
        yield [
            second.name,
            asked,
            first.name,
            *map(str, counts),
            *spread(errors),
            f"{np.mean([fix.seconds for fix in fixes]) * 1e3:.0f}",
        ]


def recognise_places(recording: Recording) -> Iterator[Row]:
    """Yield a row for each descriptor, and one for the detector's own and its voters together."""
    found = {each.name: each for each in recognise_all(recording)}
    for name, each in found.items():
        yield [name, *each.cells()]
    detector = recording.detector()
    proposing = [detector.descriptor, *detector.voters]
    several = [found.get(name) or recognise(recording, name) for name in proposing]
    yield [" + ".join(proposing), *join(several)]


class Measured:
    """The tables of some recordings.

    Attributes:
        loops, reliability, maps, fixes: rows of the tables over all recordings.
        descriptors: rows of the table of each recording, by its name.
    """

    def __init__(self) -> None:
        self.loops: list[Row] = []
        self.reliability: list[Row] = []
        self.maps: list[Row] = []
        self.fixes: list[Row] = []
        self.descriptors: dict[str, list[Row]] = {}

    def measure(self, name: str, data: Path, folder: Path, python: Path | None) -> None:
        """Measure a recording; one that is not there is skipped with a line on stderr."""
        recording = read_recording(data, name)
        if recording is None:
            note(f"without {name}, which is not in {data}")
            return
        note(f"{name}, {len(recording.clouds)} clouds")
        run = prove_loops(recording)
        self.loops += show(LOOPS, find_loops(recording, run, python))
        self.reliability += show(RELIABILITY, [[name, *count_right(run)]])
        if name in MAPPED:
            self.maps += show(MAPS, [judge_map(recording, make_map(recording, folder))])
        if name in SECOND:
            self.fixes += show(FIXES, find_in_first(recording, data, folder))
        if find_revisits(recording.poses, recording.stamps_ns, recording.rule).any():
            self.descriptors[name] = show(DESCRIPTORS, recognise_places(recording))

    def write(self) -> None:
        """Put the tables into the page, which keeps the rows of what was not measured."""
        for marker, header, rows in (
            ("loops", LOOPS, self.loops),
            ("reliability", RELIABILITY, self.reliability),
            ("maps", MAPS, self.maps),
            ("sessions", FIXES, self.fixes),
        ):
            write_between(PAGE, marker, table(header, with_other_rows(marker, rows)))
        for name, rows in self.descriptors.items():
            write_between(PAGE, f"descriptors {name}", table(DESCRIPTORS, rows))
        draw_reliability(read_rows(PAGE, "reliability"), PICTURE)
        write_between(README, "real", headline(read_rows(PAGE, "loops")))


def draw_reliability(rows: Sequence[Row], path: Path) -> None:
    """Draw the share of right poses over the stated probability, fitted recordings apart."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5, 4), layout="constrained")
    axis = figure.subplots()
    axis.plot([0, 1], [0, 1], color="0.7", label="as stated")
    groups = {"fitted to": [row for row in rows if row[0] in FITTED]}
    groups["nothing fitted to"] = [row for row in rows if row[0] not in FITTED]
    for (name, chosen), color in zip(groups.items(), ("tab:blue", "tab:orange"), strict=True):
        label: str | None = name
        for column, (low, high) in enumerate(itertools.pairwise(BINS), start=1):
            cells = [row[column].strip("()").split(" (") for row in chosen if row[column] != "-"]
            counts = np.array([float(count) for _, count in cells])
            if not counts.size:
                continue
            share = float(np.average([float(share) for share, _ in cells], weights=counts))
            axis.plot([low, high], [share, share], color=color, linewidth=3, label=label)
            label = None
    axis.set(xlabel="probability stated", ylabel="share of right poses", xlim=(0, 1))
    figure.legend(loc="outside upper center", ncols=3)
    figure.savefig(path, format="png", dpi=80)


def find_in_first(second: Recording, data: Path, folder: Path) -> list[Row]:
    """Find the frames of a second session in the map of the first; none if that is not there."""
    name, file = SECOND[second.name]
    first = read_recording(data, name)
    if first is None:
        note(f"without the map of {name}, which is not in {data}")
        return []
    poses = np.loadtxt(data / file) @ second.poses
    return list(localize(replace(second, poses=poses), first, make_map(first, folder)))


def with_other_rows(marker: str, measured: Sequence[Row]) -> list[Row]:
    """Add the rows of the page that were not measured now, in the order of the recordings."""
    names = 2 if marker in ("loops", "sessions") else 1  # columns that tell what is measured
    found = {tuple(row[:names]): row for row in measured}
    known = {tuple(row[:names]): row for row in read_rows(PAGE, marker)}
    order = list(READERS)
    return sorted(
        (known | found).values(), key=lambda row: (order.index(row[0]), row[1] == UNPROVEN)
    )


def headline(rows: Iterable[Row]) -> str:
    """Table of the revisits found by accepted loops, and of the wrong ones among all accepted."""
    shown: dict[str, dict[str, str]] = {}
    revisits = {}
    for name, found_by, _, count, recall, _, accepted, wrong, *_ in rows:
        share = "" if recall == "-" else f"{recall}; "
        by = found_by.split(" of ")[0]
        shown.setdefault(name, {})[by] = f"{share}{wrong} of {accepted} wrong"
        revisits[name] = count
    lines = [
        [name, revisits[name], *(found.get(each, "-") for each in QUOTED)]
        for name, found in shown.items()
    ]
    return table(["recording", "revisits", *QUOTED], lines)


def show(header: Sequence[str], rows: Iterable[Row]) -> list[Row]:
    """Print a table as soon as it is known."""
    listed = list(rows)
    print(f"{table(header, listed)}\n", flush=True)
    return listed


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", choices=["all", *READERS], default="all")
    parser.add_argument("--data", type=Path, help="the test data")
    parser.add_argument("--write", action="store_true", help="put the tables into the docs")
    parser.add_argument("--tilted", action="store_true", help="tilted sensors alone")
    parser.add_argument("--without-peers", action="store_true", help="ours alone")
    arguments = parser.parse_args()
    if arguments.tilted:
        tilts = show(TILTS, tilt_sensors(arguments.data or find_folder()))
        if arguments.write:
            write_between(PAGE, "tilts", table(TILTS, tilts))
        return
    python = None if arguments.without_peers else peers_python()
    measured = Measured()
    with tempfile.TemporaryDirectory() as folder:
        for name in READERS if "all" in arguments.names else arguments.names:
            measured.measure(name, arguments.data or find_folder(), Path(folder), python)
    if arguments.write:
        measured.write()


if __name__ == "__main__":
    main()
