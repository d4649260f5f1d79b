# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Routes that take a cloud or vectors: describe, query, locate."""

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from fastapi import APIRouter, Request

from fusionslam.sensors.frame import Cloud
from fusionslam.service.bodies import (
    CLOUD_FORMATS,
    VECTORS,
    body_file,
    choose_format,
    load_cloud,
    most_bytes,
    parse_vectors,
    read_body,
)
from fusionslam.service.models import Described, Found, FoundPlace, LocatedCloud, Problem
from fusionslam.service.routes.parameters import (
    BODY_ANSWERS,
    Answers,
    Count,
    Format,
    Where,
    describe_body,
)
from fusionslam.service.state import ADMITTED, Shared, State
from fusionslam.storage.arrays import Floats32

T = TypeVar("T")

router = APIRouter(prefix="/v1", dependencies=[ADMITTED], tags=["clouds"])
_FORMATS = (*CLOUD_FORMATS, VECTORS, "json")
_NOT_STORED: Answers = {
    501: {"model": Problem, "description": "The clouds of places are not stored."}
}


@router.post("/describe", responses=BODY_ANSWERS, openapi_extra=describe_body(vectors=False))
async def describe(request: Request, state: Shared, format: Format = None) -> Described:
    """Describe a cloud as the places are described."""
    places = state.places

    def work(cloud: Cloud) -> Described:
        vector = places.describe(cloud)
        return Described(
            descriptor=places.descriptor,
            length=len(vector),
            points=len(cloud),
            vector=vector.tolist(),
        )

    return await _with_cloud(request, state, format, work)


@router.post("/query", responses=BODY_ANSWERS, openapi_extra=describe_body(vectors=True))
async def query(
    request: Request, state: Shared, where: Where, k: Count, format: Format = None
) -> Found:
    """Find the places that look like a cloud, or like each of some vectors."""
    places = state.places

    def find(vectors: Floats32) -> Found:
        results = places.query(vectors, k, where)
        rows = [[FoundPlace.of(each) for each in found] for found in results]
        return Found(descriptor=places.descriptor, results=rows)

    form = choose_format(request, format, _FORMATS)
    if form in CLOUD_FORMATS:
        return await _with_cloud(
            request, state, form, lambda cloud: find(np.atleast_2d(places.describe(cloud)))
        )
    most = state.config.max_vectors
    with state.workers.place():
        body = await read_body(request, state.config, most_bytes(state.config, places.length))
        return await state.workers.run(lambda: find(parse_vectors(body, form, places.length, most)))


@router.post(
    "/locate", responses=BODY_ANSWERS | _NOT_STORED, openapi_extra=describe_body(vectors=False)
)
async def locate(
    request: Request, state: Shared, where: Where, k: Count, format: Format = None
) -> LocatedCloud:
    """Find where a cloud is, proven by registration with the clouds of its candidates."""

    def work(cloud: Cloud) -> LocatedCloud:
        return LocatedCloud.of(state.places.locate(cloud, k, where))

    return await _with_cloud(request, state, format, work)


async def _with_cloud(
    request: Request, state: State, format: str | None, work: Callable[[Cloud], T]
) -> T:
    """Receive a cloud, then read it and work on it in a thread."""
    form = choose_format(request, format, CLOUD_FORMATS)
    with state.workers.place():
        async with body_file(request, state.config, form) as path:
            return await state.workers.run(lambda: work(load_cloud(path, state.config.max_points)))
