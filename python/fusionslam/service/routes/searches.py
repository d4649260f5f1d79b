# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Routes that take a cloud or vectors: describe, query, locate."""

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from typing import TypeVar

from fastapi import APIRouter, Request

from fusionslam.base.arrays import Floats32
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
    SEARCH_PARAMETERS,
    Answers,
    Count,
    Format,
    Where,
    describe_body,
    take_only,
)
from fusionslam.service.state import ADMITTED, Client, Shared, State

T = TypeVar("T")

router = APIRouter(prefix="/v1", dependencies=[ADMITTED], tags=["clouds"])
_FORMATS = (*CLOUD_FORMATS, VECTORS, "json")
_SMALL = 100_000
"""Bytes that are parsed at once: a thread would take longer to begin."""
_NOT_STORED: Answers = {
    501: {"model": Problem, "description": "The clouds of places are not stored."}
}


@router.post(
    "/describe",
    dependencies=[take_only("format")],
    responses=BODY_ANSWERS,
    openapi_extra=describe_body(vectors=False),
)
async def describe(
    request: Request, state: Shared, client: Client, format: Format = None
) -> Described:
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

    return await _with_cloud(request, state, client, format, work)


@router.post(
    "/query",
    dependencies=[SEARCH_PARAMETERS],
    responses=BODY_ANSWERS,
    openapi_extra=describe_body(vectors=True),
)
async def query(
    request: Request, state: Shared, client: Client, where: Where, k: Count, format: Format = None
) -> Found:
    """Find the places that look like a cloud, or like each of some vectors."""
    form = choose_format(request, format, _FORMATS)
    find = partial(state.batches.find, k=k, where=where)
    if form in CLOUD_FORMATS:
        async with _received(request, state, client, form) as path:
            vector = await _work_on(path, state, client, state.places.describe)
            results = await find(vector[None])
    else:
        body = await _receive_vectors(request, state, client)
        with state.waiting.place(client):
            results = await find(await _parse(body, form, state, client))
    rows = [[FoundPlace.of(each) for each in found] for found in results]
    return Found(descriptor=state.places.descriptor, results=rows)


@router.post(
    "/locate",
    dependencies=[SEARCH_PARAMETERS],
    responses=BODY_ANSWERS | _NOT_STORED,
    openapi_extra=describe_body(vectors=False),
)
async def locate(
    request: Request, state: Shared, client: Client, where: Where, k: Count, format: Format = None
) -> LocatedCloud:
    """Find where a cloud is, proven by registration with the clouds of its candidates."""

    def work(cloud: Cloud) -> LocatedCloud:
        return LocatedCloud.of(state.places.locate(cloud, k, where), state.places.joint_map)

    return await _with_cloud(request, state, client, format, work)


async def _with_cloud(
    request: Request, state: State, client: str, format: str | None, work: Callable[[Cloud], T]
) -> T:
    form = choose_format(request, format, CLOUD_FORMATS)
    async with _received(request, state, client, form) as path:
        return await _work_on(path, state, client, work)


@asynccontextmanager
async def _received(request: Request, state: State, client: str, form: str) -> AsyncIterator[Path]:
    """Receive a cloud, and only then take a place for the block: slow clients take none."""
    state.waiting.check(client)  # before it is received in vain
    with state.bodies.place(client):
        async with body_file(request, state.config, form) as path:
            with state.waiting.place(client):
                yield path


async def _work_on(path: Path, state: State, client: str, work: Callable[[Cloud], T]) -> T:
    """Read a cloud and work on it in a thread."""
    return await state.describers.run(lambda: work(load_cloud(path, state.config)), client)


async def _receive_vectors(request: Request, state: State, client: str) -> bytes:
    most = most_bytes(state.config, state.places.length)
    state.waiting.check(client)
    with state.bodies.place(client):
        return await read_body(request, state.config, most)


async def _parse(body: bytes, form: str, state: State, client: str) -> Floats32:
    parse = partial(parse_vectors, body, form, state.places.length, state.config.max_vectors)
    if len(body) < _SMALL:
        return parse()
    return await state.workers.run(parse, client)
