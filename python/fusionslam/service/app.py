# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The web application: routes, limits, errors and metrics put together."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from fastapi import Depends, FastAPI
from fastapi_offline import FastAPIOffline

from fusionslam._core import __version__
from fusionslam.service.batches import QueryBatches
from fusionslam.service.config import ServiceConfig
from fusionslam.service.keys import ApiKeys
from fusionslam.service.metrics import CountRequests, Metrics
from fusionslam.service.places import PlaceCount, ServedPlaces
from fusionslam.service.problems import answer_problems
from fusionslam.service.routes import lookups, pages, searches
from fusionslam.service.state import Rates, State, check_framing
from fusionslam.service.workers import Room, Workers

_NICENESS = 5
"""Of threads that describe: a third of the time of a core that others want as well."""
_ABOUT = (
    "Describes clouds and finds the places of a fleet that look like them. Errors are JSON with "
    "code, message and fields."
)


def create_app(
    folder: Path, config: ServiceConfig | None = None, keys: ApiKeys | None = None
) -> FastAPI:
    """Make the application.

    Args:
        folder: of ``fusionslam fleet describe``, whose places are served.
        config: limits; None for the defaults.
        keys: who may use it; None for everybody on this machine.

    Raises:
        DataError: it is no such folder, or it is damaged.
    """
    config = config or ServiceConfig()
    places, workers = ServedPlaces(folder), Workers(config.workers)
    describers = Workers(config.workers, _NICENESS)
    shared = State(
        config,
        places,
        keys or ApiKeys(),
        Rates(config.requests_per_minute),
        workers,
        describers,
        Room(config.max_waiting, config.max_waiting_of_one),
        Room(config.max_connections, config.max_bodies_of_one),
        QueryBatches(places, workers),
        Metrics(),
        PlaceCount(places),
    )

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        yield
        workers.close()
        describers.close()
        shared.count.close()
        places.close()

    app = FastAPIOffline(
        title="fusionslam",
        version=__version__,
        description=_ABOUT,
        lifespan=lifespan,
        dependencies=[Depends(check_framing)],
        redoc_url=None,
        swagger_ui_oauth2_redirect_url="/docs/oauth2-redirect",
    )
    app.state.shared = shared
    app.add_middleware(CountRequests, metrics=shared.metrics)
    answer_problems(app)
    for router in (searches.router, lookups.places, lookups.status, pages.router):
        app.include_router(router)
    return app
