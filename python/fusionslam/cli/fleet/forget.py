# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command fleet forget: places leave the database for good."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from fusionslam.cli import options as opt
from fusionslam.cli.fleet.options import Places, open_folder, where
from fusionslam.help_texts import counted

if TYPE_CHECKING:
    from fusionslam.fleet.places import PlaceFilter


@opt.options_of(where=where)
def forget(places: Places, *, where: "Callable[[], PlaceFilter]") -> None:
    """Delete all places of a robot, recording, site or region, with their clouds and maps.

    No query finds them any more, and fleet describe leaves their recordings out from now on
    (forgotten.json).
    """
    count = open_folder(places).forget(where())
    print(f"{counted(count, 'place')} forgotten; such recordings are left out from now on")
