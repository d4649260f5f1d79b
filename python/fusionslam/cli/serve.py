# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command serve: places of a fleet over HTTP."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fusionslam.base.texts import counted
from fusionslam.cli import options as opt
from fusionslam.cli.failures import needs_extra

if TYPE_CHECKING:
    from fusionslam.service.config import ServiceConfig


@opt.command
def serve(
    folder: Annotated[
        Path, typer.Argument(metavar="PLACES", help="Folder of fleet describe, with places.")
    ],
    host: Annotated[
        str | None,
        typer.Option("--host", help="Name or address to listen on; 127.0.0.1 by default."),
    ] = None,
    port: Annotated[
        int | None,
        typer.Option("--port", min=0, max=65535, help="8766 by default; 0 is any that is free."),
    ] = None,
    api_keys: Annotated[
        Path | None,
        typer.Option("--api-keys", metavar="FILE", help="Lines with a name and an API key."),
    ] = None,
    without_keys: Annotated[
        bool,
        typer.Option("--without-keys", help="Let anyone who reaches --host in, without a key."),
    ] = False,
    *,
    read_config: opt.ReadConfig,
) -> None:
    """Describe clouds and find places over HTTP, until Ctrl-C or SIGTERM.

    The page at its address shows sites and finds scans; /docs lists the interface. Keys also come
    from the environment: FUSIONSLAM_API_KEYS.
    """
    for module in (
        "fastapi",
        "fastapi_offline",
        "lancedb",
        "limits",
        "prometheus_client",
        "uvicorn",
    ):
        needs_extra("fleet", module=module)
    from fusionslam.service.app import create_app
    from fusionslam.service.keys import ApiKeys
    from fusionslam.service.listening import check_exposure, listen, serve, url_of

    config = _config(read_config().service, host, port)
    keys = ApiKeys.load(api_keys)
    check_exposure(config, keys, without_keys=without_keys)
    app = create_app(folder, config, keys)
    places = counted(len(app.state.shared.places), "place")
    with listen(config) as listener:
        print(f"{url_of(listener)}: {places} of {folder}", flush=True)
        serve(app, listener, config)
    print("ended")


def _config(config: "ServiceConfig", host: str | None, port: int | None) -> "ServiceConfig":
    """Return the configuration with the options that are given."""
    from fusionslam.config import merged

    given = {"host": host, "port": port}
    return merged(config, {name: value for name, value in given.items() if value is not None})
