# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The commands map show, map export and map check."""

from pathlib import Path
from typing import Annotated

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.failures import needs_extra

MapPath = Annotated[Path, typer.Argument(metavar="MAP", help="A map's file (.fsmap).")]


@opt.options_of()
def show(
    path: MapPath,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Also write a page that shows it in 3-D (X.html)."),
    ] = None,
) -> None:
    """Print the sessions, loops and size of a map, or show it in 3-D."""
    needs_extra("map")
    from fusionslam.mapping import PlaceMap

    with PlaceMap.open(path, read_only=True) as site:
        print(site.describe())
        if output is not None:
            from fusionslam.report.place_maps import write_map_view

            print(write_map_view(output, site))


@opt.options_of()
def export(
    path: MapPath,
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
            "north.",
        ),
    ] = None,
) -> None:
    """Write a map for other programs: clouds, grid, heights, trajectories."""
    needs_extra("map")
    from fusionslam.mapping import PlaceMap
    from fusionslam.mapping.geojson import parse_origin
    from fusionslam.pipelines.place_maps import export_map

    place = None if origin is None else parse_origin(origin)
    with PlaceMap.open(path, read_only=True) as site:
        files = export_map(site, output, voxel=voxel, resolution=resolution, origin=place)
    for file in files:
        print(file)


@opt.options_of()
def check(path: MapPath) -> None:
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
