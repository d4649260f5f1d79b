# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The commands ``fusionslam map ...``."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, cast

import typer

from fusionslam.base.files import is_map_file
from fusionslam.base.progress import label_progress
from fusionslam.base.texts import counted
from fusionslam.cli import options as opt
from fusionslam.cli.console import during, progress
from fusionslam.cli.failures import keep, needs_extra
from fusionslam.cli.recordings import BuildRecording
from fusionslam.errors import ConfigError

if TYPE_CHECKING:
    from fusionslam.base.arrays import Matrix
    from fusionslam.mapping import Edge
    from fusionslam.pipelines.place_maps import MapOdometry

app = typer.Typer(
    help="Build maps that last, and find robots on them.",
    no_args_is_help=True,
    rich_markup_mode=None,
)

ODOMETRY = ("recorded", "lidar", "inertial", "truth+noise")
Odometry = Annotated[
    str,
    opt.one_of(
        "--odometry",
        names=ODOMETRY,
        help="The recording's, that of its scans (extra odometry), of scans and IMU (extra "
        "inertial), or true poses with errors (--set odometry.KEY).",
    ),
]


@app.command()
@opt.command
def build(
    ctx: typer.Context,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="The map's file (.fsmap), made or gone on with.")
    ] = Path("out/site.fsmap"),
    session: Annotated[
        str | None,
        typer.Option("--session", metavar="NAME", help="Of the drive; by default the recording's."),
    ] = None,
    descriptor: Annotated[
        str | None,
        typer.Option(
            "--descriptor",
            "-d",
            metavar="NAME",
            help="Of a new map: by default cm2dp, or m2dp where clouds have no colours.",
        ),
    ] = None,
    odometry: Odometry = "recorded",
    source: opt.Source = None,
    trajectory: Annotated[
        Path | None,
        typer.Option("--trajectory", metavar="FILE", help="Also write each frame's pose (TUM)."),
    ] = None,
    *,
    build_recording: BuildRecording,
    read_config: opt.ReadConfig,
    skip_bad_frames: opt.SkipBad = False,
    jobs: opt.Jobs = None,
    no_report: opt.NoReport = False,
) -> None:
    """Add DATA to a map: keyframes, loops and poses.

    Each keyframe is on the disk at once: the same command goes on where an interrupted one ended.
    A map keeps the configuration that it was made with. A page beside it shows it.
    """
    needs_extra("map")
    if not no_report:
        needs_extra("report", unless="--no-report")
    from fusionslam.cli.data import open_data
    from fusionslam.cli.map_building import describe_growth, finish_map
    from fusionslam.config import merged
    from fusionslam.datasets import write_poses_tum
    from fusionslam.descriptors import load_descriptor
    from fusionslam.mapping import PlaceMap
    from fusionslam.mapping.frame_poses import frame_poses
    from fusionslam.mapping.place_map import DEFAULT_DESCRIPTOR
    from fusionslam.pipelines.describe import describable
    from fusionslam.pipelines.place_maps import (
        build_map,
        check_odometry,
        odometry_of,
    )

    if output.suffix == ".html":
        raise ConfigError(
            f"--output is {output}: expected the map's file (.fsmap), beside which its page is "
            "written",
            code="choice",
            fields=("--output", str(output)),
        )
    if not is_map_file(output):
        opt.check_output(output, build_recording, read_config)
    if trajectory is not None:
        opt.check_output(trajectory, output, build_recording, read_config)
    kind = cast("MapOdometry", opt.check_choice("odometry", odometry, ODOMETRY))
    if descriptor is not None:
        load_descriptor(descriptor)
    whole = read_config()
    recording = build_recording()
    if source is not None:
        whole = merged(whole, {"fusion": {"source": source}})
    cores = opt.cores(jobs)
    keep(ctx, output)
    with progress() as step:
        with during(step):
            dataset, whole = open_data(recording, whole)
        check_odometry(dataset, kind)
        name = session or Path(recording.path).stem
        given = whole.loop_closure.model_fields_set
        loops = merged(whole.loop_closure, {} if "window" in given else {"window": 20})
        if descriptor is None and not output.exists():
            usual = [DEFAULT_DESCRIPTOR]
            (descriptor,) = describable(dataset, usual, whole, "skip", replace=True)
        site = PlaceMap.open(
            output,
            name,
            descriptor=descriptor,
            loops=loops,
            describe=whole.descriptors,
            fusion=whole.fusion,
            registration=whole.registration,
            config=whole.mapping,
        )
        with site:
            site.check_recording(dataset.name)
            poses = odometry_of(
                dataset,
                kind,
                scanned=whole.lidar_odometry,
                errors=whole.odometry,
                jobs=cores,
                step=step,
            )
            built = build_map(
                site,
                dataset,
                poses,
                bad_frames=opt.bad_frames(skip_bad_frames),
                jobs=cores,
                progress=label_progress(step, "mapping"),
            )
            warning, window = site.reason, site.settings.loops.window
            if trajectory is not None:
                frames = frame_poses(site, name)
                write_poses_tum(trajectory, frames.stamps_ns, frames.poses)
        page = None if no_report else output.with_suffix(".html")
        lines = finish_map(output, name, dataset, kind, page, step, warning)
    print(f"{name}: {describe_growth(built, window)}")
    for line in [*lines, *map(str, filter(None, (output, page, trajectory)))]:
        print(line)


@app.command()
@opt.command
def show(
    path: opt.MapFile,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Also write a page that shows it (X.html)."),
    ] = None,
) -> None:
    """Print sessions, loops, quality and corrections of a map, and write a page that shows it.

    The page has trajectories, loops and reasons, how good the map is and where it is weak, cloud
    and grid from above, and a view in 3-D.
    """
    needs_extra("map")
    if output is not None:
        needs_extra("report")
        opt.check_output(output, path)
    from fusionslam.mapping import PlaceMap, judge_map

    with PlaceMap.open(path, read_only=True) as site:
        print(site.describe())
        if len(site):
            print(judge_map(site, surfaces=False).describe())
        for correction in site.corrections:
            print(correction)
        if output is not None:
            from fusionslam.report.place_maps import write_map_page

            print(write_map_page(output, site, command=opt.command_line()))


@app.command()
@opt.command
def localize(
    path: Annotated[
        Path, typer.Option("--map", metavar="MAP", help="The map's file (.fsmap).")
    ] = Path("out/site.fsmap"),
    output: Annotated[Path, typer.Option("--output", "-o", help="CSV file for the poses.")] = Path(
        "out/localizations.csv"
    ),
    *,
    build_recording: BuildRecording,
    read_config: opt.ReadConfig,
    skip_bad_frames: opt.SkipBad = False,
    jobs: opt.Jobs = None,
) -> None:
    """Find each frame of DATA on a map, without any guess. Recorded odometry helps."""
    needs_extra("map")
    opt.check_output(output, path, build_recording, read_config)
    from fusionslam.cli.map_building import open_for_map
    from fusionslam.config import merged
    from fusionslam.mapping import PlaceMap
    from fusionslam.pipelines.place_maps import (
        Localized,
        has_odometry,
        localize_recording,
        odometry_of,
        write_localizations,
    )

    with PlaceMap.open(path, read_only=True) as site, progress() as step:
        config = read_config()
        for key in sorted(config.fusion.model_fields_set):
            if getattr(config.fusion, key) != (own := getattr(site.fusion, key)):
                raise ConfigError(
                    f"fusion.{key} is {getattr(config.fusion, key)}, but clouds are made as those "
                    f"of the map, where it is {own}: leave it out",
                    code="other-config",
                    fields=(f"fusion.{key}",),
                )
        whole = merged(config, {"fusion": site.fusion.model_dump()})
        with during(step):
            dataset = open_for_map(build_recording(), whole)
        poses = odometry_of(dataset, "recorded") if has_odometry(dataset) else None
        found = [
            *localize_recording(
                site,
                dataset,
                poses,
                bad_frames=opt.bad_frames(skip_bad_frames),
                jobs=opt.cores(jobs),
                progress=label_progress(step, "localising"),
            )
        ]
    write_localizations(output, found)
    print(Localized.of(found))
    print(output)


@app.command()
@opt.command
def merge(
    path: opt.MapFile,
    other: Annotated[
        Path, typer.Argument(metavar="OTHER", help="The map that is taken in; it stays as it is.")
    ],
) -> None:
    """Take the sessions of OTHER into MAP, if three loops between both agree.

    Else nothing changes, the loops are listed, and the exit status is 1.
    """
    needs_extra("map")
    from fusionslam.mapping import PlaceMap

    if path.exists() and other.exists() and path.samefile(other):
        raise ConfigError(
            f"MAP {path} and OTHER {other} are the same file: expected two maps",
            code="same-file",
            fields=(str(path), str(other)),
        )
    with PlaceMap.open(path) as site:
        with progress() as step:
            done = site.merge(other, progress=label_progress(step, "comparing keyframes"))
        if done.reason is None:
            print(f"{', '.join(done.sessions)}: {len(done.believed)} loops join the maps")
            print(site.describe())
            return
    print(f"not merged: {done.reason}")
    for edge in done.refused:
        print(f"keyframe {edge.a} and {edge.b} of {other}: {edge.reason}")
    raise typer.Exit(1)


@app.command()
@opt.command
def forget(
    path: opt.MapFile,
    session: Annotated[str, typer.Argument(metavar="SESSION", help="Name of the drive.")],
) -> None:
    """Delete a session of MAP: its keyframes and their loops. That undoes a merge, too."""
    needs_extra("map")
    from fusionslam.mapping import PlaceMap

    with PlaceMap.open(path) as site:
        site.forget(session)
        print(site.describe())


A = Annotated[int, typer.Argument(metavar="A", help="Number of a keyframe.")]
B = Annotated[int, typer.Argument(metavar="B", help="Number of another one.")]
Metres = Annotated[
    float, typer.Option("--metres", help="Standard deviation of the pose, along each axis.")
]
Degrees = Annotated[
    float, typer.Option("--degrees", help="Standard deviation of the pose, about each axis.")
]
Force = Annotated[
    bool, typer.Option("--force", help="Even if clouds or graph contradict it; it is marked.")
]
Why = Annotated[str, typer.Option("--why", metavar="TEXT", help="The reason; map show lists it.")]
_POSE = "X,Y,Z[,ROLL,PITCH],YAW"


@app.command()
@opt.command
def link(
    path: opt.MapFile,
    a: A,
    b: B,
    pose: Annotated[
        str | None,
        typer.Option(
            "--pose",
            metavar=_POSE,
            help="Of the robot at B in its frame at A, metres and degrees; by default that of "
            "their clouds.",
        ),
    ] = None,
    metres: Metres = 0.1,
    degrees: Degrees = 1.0,
    force: Force = False,
    why: Why = "",
) -> None:
    """Put a loop between two keyframes into MAP, if their clouds and the graph agree.

    Else nothing changes, the reason is printed, and the exit status is 1.
    """
    needs_extra("map")
    from fusionslam.mapping import PlaceMap

    given = None if pose is None else _parse_pose("--pose", pose)
    with PlaceMap.open(path) as site:
        corrections = site.corrections
        _print_change(
            corrections.link(a, b, given, metres=metres, degrees=degrees, force=force, why=why)
        )


@app.command()
@opt.command
def unlink(
    path: opt.MapFile,
    a: A,
    b: B,
    why: Why = "",
) -> None:
    """Take the loops between two keyframes out of MAP, for good."""
    needs_extra("map")
    from fusionslam.mapping import PlaceMap

    with PlaceMap.open(path) as site:
        gone = site.corrections.unlink(a, b, why=why)
    print(f"keyframes {a} and {b}: {counted(len(gone), 'loop')} taken out")


# A pose may begin with a minus.
@app.command(context_settings={"ignore_unknown_options": True})
@opt.command
def fix(
    path: opt.MapFile,
    keyframe: Annotated[int, typer.Argument(metavar="KEYFRAME", help="Number of a keyframe.")],
    pose: Annotated[
        str,
        typer.Argument(
            metavar=_POSE, help="Of the robot in the frame of the map, metres and degrees."
        ),
    ],
    metres: Metres = 0.1,
    degrees: Degrees = 1.0,
    force: Force = False,
    why: Why = "",
) -> None:
    """Hold a keyframe of MAP where a survey has it, if the graph agrees.

    Else nothing changes, the reason is printed, and the exit status is 1.
    """
    needs_extra("map")
    from fusionslam.mapping import PlaceMap

    given = _parse_pose("POSE", pose)
    with PlaceMap.open(path) as site:
        _print_change(
            site.corrections.fix(
                keyframe, given, metres=metres, degrees=degrees, force=force, why=why
            )
        )


@app.command()
@opt.command
def undo(path: opt.MapFile, why: Why = "") -> None:
    """Take the last correction of MAP by hand back: link, unlink or fix."""
    needs_extra("map")
    from fusionslam.mapping import PlaceMap

    with PlaceMap.open(path) as site:
        print(f"undone: {site.corrections.undo(why=why)}")


def _print_change(edge: "Edge") -> None:
    print(f"keyframes {edge.a} and {edge.b}: {edge.state}, {edge.reason}")
    if edge.state == "refused":
        print("nothing was changed; --force keeps it nevertheless")
        raise typer.Exit(1)


def _parse_pose(name: str, text: str) -> "Matrix":
    import numpy as np

    from fusionslam.geometry.rigid import rotation

    try:
        values = [float(cell) for cell in text.split(",")]
        if len(values) not in (4, 6) or not all(map(math.isfinite, values)):
            raise ValueError(text)
    except ValueError as error:
        raise ConfigError(
            f"{name} {text!r}: expected {_POSE}, numbers in metres and degrees",
            code="choice",
            fields=(name, text),
        ) from error
    roll, pitch, yaw = values[3:] if len(values) == 6 else [0, 0, values[3]]
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation(np.radians([roll, pitch, yaw]).tolist()), values[:3]
    return pose


FRAMES = ("map", "utm")


@app.command()
@opt.command
def export(
    path: opt.MapFile,
    output: opt.Folder = Path("out/map"),
    voxel: Annotated[float, typer.Option("--voxel", min=0.01, help="Of the cloud, metres.")] = 0.1,
    resolution: Annotated[
        float, typer.Option("--resolution", min=0.01, help="Of the grid, metres.")
    ] = 0.05,
    origin: Annotated[
        str | None,
        typer.Option(
            "--origin",
            metavar="LAT,LON[,ALT[,HEADING]]",
            help="Where the map is: degrees, metres, and degrees of its x axis from east towards "
            "north; by default where its fixes say.",
        ),
    ] = None,
    frame: Annotated[
        str,
        opt.one_of(
            "--frame",
            names=FRAMES,
            help="Of the poses: the map's, or UTM where it is on the globe.",
        ),
    ] = "map",
    covariance: Annotated[
        bool, typer.Option("--covariance", help="Write poses with covariances, too (SESSION.csv).")
    ] = False,
) -> None:
    """Write a map for other programs: clouds, grid, heights, graph, poses of all frames."""
    needs_extra("map")
    from fusionslam.geometry.globe import parse_origin
    from fusionslam.mapping import PlaceMap
    from fusionslam.pipelines.place_maps import export_map

    place = None if origin is None else parse_origin(origin)
    chosen = cast("Literal['map', 'utm']", opt.check_choice("frame", frame, FRAMES))
    with PlaceMap.open(path, read_only=True) as site:
        files = export_map(
            site,
            output,
            voxel=voxel,
            resolution=resolution,
            origin=place,
            frame=chosen,
            covariance=covariance,
        )
        first = site.content.parts[0]
    for file, track in files.items():
        about = ""
        if track is not None:
            about = f": session {track.session}"
            about += f", part {track.part}" if track.part != first else ""
        print(f"{file}{about}")


@app.command()
@opt.command
def check(path: opt.MapFile) -> None:
    """Read a map whole; say what is damaged, with exit status 1."""
    needs_extra("map")
    from fusionslam.mapping import PlaceMap

    with PlaceMap.open(path, read_only=True) as site:
        problems = site.check()
        print(f"{path}: {len(site)} keyframes, {len(problems) or 'nothing'} damaged")
    for problem in problems:
        print(problem)
    if problems:
        raise typer.Exit(1)
