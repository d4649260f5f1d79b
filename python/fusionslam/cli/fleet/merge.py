# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command fleet merge: the joint map of a site."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import progress
from fusionslam.cli.failures import keep, needs_extra
from fusionslam.cli.fleet.options import Places
from fusionslam.cli.maps.build import ODOMETRY, Odometry
from fusionslam.help_texts import counted

if TYPE_CHECKING:
    from fusionslam.pipelines.place_maps import MapOdometry


@opt.options_of(read_config=opt.read_config)
def merge(
    ctx: typer.Context,
    places: Places,
    site: Annotated[str, typer.Argument(metavar="SITE", help="Name of the site.")],
    odometry: Odometry = "recorded",
    *,
    read_config: "Callable[[], Any]",
    jobs: opt.Jobs = None,
) -> None:
    """Join all drives at SITE in one map; drives that came since the last call are added.

    A drive that no three loops join with the others is left out until others join it. One whose
    recording has changed is mapped and joined anew. The exit status is 1 if one is left out.
    """
    needs_extra("map")
    from fusionslam.fleet.config import FleetSettings
    from fusionslam.fleet.site_maps import merge_site
    from fusionslam.fleet.work import Plan
    from fusionslam.mapping import PlaceMap

    whole = read_config()
    settings, plan = FleetSettings.load(places), Plan.load(places)
    keep(ctx, places)
    with progress() as step:
        done = merge_site(
            places,
            site,
            plan.recordings,
            settings,
            odometry=cast("MapOdometry", opt.check_choice("odometry", odometry, ODOMETRY)),
            mapping=whole.mapping,
            jobs=opt.cores(jobs),
            step=step,
        )
    for session, reason in done.left_out.items():
        print(f"left out: {session}: {reason}")
    print(f"{counted(len(done.added), 'drive')} added, {len(done.known)} known")
    if done.path.exists():
        with PlaceMap.open(done.path, read_only=True) as joint:
            print(joint.describe())
        print(done.path)
    if done.left_out:
        raise typer.Exit(1)
