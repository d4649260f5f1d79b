# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Routes for those who run the service: health and metrics."""

from fastapi import APIRouter, Response
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest

from fusionslam.service.models import Health
from fusionslam.service.routes.parameters import ANSWERS
from fusionslam.service.state import ADMITTED, Shared

router = APIRouter(tags=["status"])


@router.get("/health", responses={503: {"model": Health, "description": "Not ready."}})
async def health(state: Shared, response: Response) -> Health:
    """Say whether the service is ready: 200, or 503 if its places cannot be read. Needs no key."""
    places = await state.count.get()
    if places is None:
        response.status_code = 503
    return Health(status="unavailable" if places is None else "ready", places=places)


@router.get("/metrics", dependencies=[ADMITTED], responses=ANSWERS, response_class=Response)
async def metrics(state: Shared) -> Response:
    """Show counters and times for Prometheus."""
    places = await state.count.get()
    state.metrics.places.set(float("nan") if places is None else places)
    state.metrics.waiting.set(state.waiting.taken)
    return Response(generate_latest(state.metrics.registry), media_type=CONTENT_TYPE_LATEST)
