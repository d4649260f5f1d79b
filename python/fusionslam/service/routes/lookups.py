# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Routes that say which places there are, and for those who run the service: health, metrics."""

from fastapi import APIRouter, Response
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest

from fusionslam.service.models import Counts, Health, Problem, SitePaths
from fusionslam.service.problems import RequestError
from fusionslam.service.routes.parameters import ANSWERS, Answers, take_only
from fusionslam.service.state import ADMITTED, Client, Shared

status = APIRouter(tags=["status"])
places = APIRouter(
    prefix="/v1", dependencies=[ADMITTED, take_only()], tags=["places"], responses=ANSWERS
)
_NO_SITE: Answers = {404: {"model": Problem, "description": "There is no such site."}}


@places.get("/places")
async def count_places(state: Shared, client: Client) -> Counts:
    """Count the places by site, region, session and robot."""
    served = state.places

    def work() -> Counts:
        columns = {f"{name}s": served.count_by(name) for name in ("region", "session", "robot")}
        return Counts(
            descriptor=served.descriptor,
            length=served.length,
            proves=served.proves,
            places=len(served),
            sites=served.count_by("site"),
            **columns,
        )

    with state.waiting.place(client):
        return await state.workers.run(work, client)


@places.get("/sites/{site:path}", responses=_NO_SITE)
async def show_site(site: str, state: Shared, client: Client) -> SitePaths:
    """Return where the places of a site are, by session, and its joint map if it has one.

    An empty name is that of no site.
    """
    served, most = state.places, state.config.max_positions

    def work() -> SitePaths:
        found = served.positions(site, most)
        if not found.counts:
            message = f"there is no site {site!r}; /v1/places lists them"
            raise RequestError(404, message, code="unknown-site", fields=(site,))
        return SitePaths.of(site, found, served.joint_map(site), most)

    with state.waiting.place(client):
        return await state.workers.run(work, client)


@status.get("/health", responses={503: {"model": Health, "description": "Not ready."}})
async def health(state: Shared, response: Response) -> Health:
    """Say whether the service is ready: 200, or 503 if its places cannot be read. Needs no key."""
    places = await state.count.get()
    if places is None:
        response.status_code = 503
    return Health(status="unavailable" if places is None else "ready", places=places)


@status.get("/metrics", dependencies=[ADMITTED], responses=ANSWERS, response_class=Response)
async def metrics(state: Shared) -> Response:
    """Show counters and times for Prometheus."""
    places = await state.count.get()
    state.metrics.places.set(float("nan") if places is None else places)
    state.metrics.waiting.set(state.waiting.taken)
    return Response(generate_latest(state.metrics.registry), media_type=CONTENT_TYPE_LATEST)
