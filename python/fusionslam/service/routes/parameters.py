# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters that several routes share, and how their pages describe them."""

from typing import Annotated, Any

from fastapi import Depends, Query, Request

from fusionslam.errors import DataError
from fusionslam.fleet.places import PlaceFilter
from fusionslam.service.bodies import CLOUD_FORMATS
from fusionslam.service.models import Problem
from fusionslam.service.problems import RequestError
from fusionslam.service.state import Shared

_LATEST = 2**63 - 1
_USUAL = 10
"""Candidates of each query."""
_Name = Annotated[str | None, Query(max_length=500, pattern=r"^[^\x00-\x1f\x7f]*$")]
_Time = Annotated[int | None, Query(ge=-_LATEST, le=_LATEST, description="Nanoseconds.")]

_FILTERS = ("site", "region", "robot", "session", "not_session", "since_ns", "until_ns")


def take_only(*known: str) -> Any:
    """Return a dependency that refuses parameters of the address other than these.

    A misspelt filter would be ignored without a word otherwise.

    Raises:
        DataError: code "unknown-parameter".
    """

    async def check(request: Request) -> None:
        for name in request.query_params:
            if name not in known:
                message = f"unknown parameter {name!r}; known: {', '.join(known) or 'none'}"
                raise DataError(message, code="unknown-parameter", fields=(name,))

    return Depends(check)


SEARCH_PARAMETERS = take_only(*_FILTERS, "k", "format")
"""Of routes that search."""


async def _filter_of(
    site: _Name = None,
    region: _Name = None,
    robot: _Name = None,
    session: _Name = None,
    not_session: _Name = None,
    since_ns: _Time = None,
    until_ns: _Time = None,
) -> PlaceFilter:
    """Return which places are meant."""
    return PlaceFilter(site, region, robot, session, not_session, since_ns, until_ns)


async def _number_of_candidates(
    state: Shared,
    k: Annotated[int | None, Query(ge=1, description="Candidates of each query; 10.")] = None,
) -> int:
    most = state.config.max_k
    if k is None:
        return min(_USUAL, most)
    if k > most:
        message = f"k is {k}, expected at most {most}"
        raise RequestError(422, message, code="parameter", fields=("k", str(most)))
    return k


Where = Annotated[PlaceFilter, Depends(_filter_of)]
Count = Annotated[int, Depends(_number_of_candidates)]
Format = Annotated[
    str | None, Query(description="Of the body, unless its content type says it.", max_length=20)
]

Answers = dict[int | str, dict[str, Any]]
"""What routes say of statuses other than 200."""

ANSWERS: Answers = {
    status: {"model": Problem, "description": text}
    for status, text in {
        401: "No API key, or a wrong one.",
        422: "Something in the request is wrong; code and fields say what.",
        429: "Too many requests; the header Retry-After says when to try again.",
        503: "Too busy, or the places cannot be read now.",
    }.items()
}
BODY_ANSWERS: Answers = ANSWERS | {
    status: {"model": Problem, "description": text}
    for status, text in {
        408: "The body did not come in time.",
        413: "The body is too long, or holds too many points or vectors.",
        415: "The body is of an unknown format.",
    }.items()
}
_BINARY = {"schema": {"type": "string", "format": "binary"}}


def describe_body(*, vectors: bool) -> dict[str, Any]:
    """Return what the OpenAPI page says of a body: a cloud, or else vectors."""
    formats = f"A scan like those of the places; ?format= is one of {', '.join(CLOUD_FORMATS)}"
    content: dict[str, Any] = {"application/octet-stream": _BINARY}
    if vectors:
        formats += ', vectors (a .npy array). JSON is {"vector": [..]} or {"vectors": [[..], ..]}'
        rows = {"type": "array", "items": {"type": "number"}}
        schema = {"type": "object", "properties": {"vector": rows, "vectors": _list_of(rows)}}
        content["application/json"] = {"schema": schema}
    return {"requestBody": {"required": True, "description": f"{formats}.", "content": content}}


def _list_of(items: dict[str, Any]) -> dict[str, Any]:
    return {"type": "array", "items": items}
