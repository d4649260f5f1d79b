# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command map export: files for other programs."""

from pathlib import Path
from typing import Annotated

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.failures import needs_extra


@opt.options_of()
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
            "north.",
        ),
    ] = None,
) -> None:
    """Write a map for other programs: clouds, grid, heights, graph, trajectories."""
    needs_extra("map")
    from fusionslam.mapping import PlaceMap
    from fusionslam.mapping.geojson import parse_origin
    from fusionslam.pipelines.place_maps import export_map, trajectory_files

    place = None if origin is None else parse_origin(origin)
    with PlaceMap.open(path, read_only=True) as site:
        files = export_map(site, output, voxel=voxel, resolution=resolution, origin=place)
        sessions = trajectory_files(site)
    for file in files:
        session = sessions.get(file.name)
        print(file if session is None else f"{file}: session {session}")
