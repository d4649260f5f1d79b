# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Errors as answers over HTTP: a status and JSON with code, message and fields."""

import logging
from collections.abc import Mapping, Sequence
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect

from fusionslam.errors import FusionSlamError, one_line, reason_of

logger = logging.getLogger(__name__)

_CODES = {404: "no-such-page", 405: "wrong-method"}


class RequestError(FusionSlamError):
    """A request that is not answered: its status, and headers that say what would be.

    Attributes:
        status: of HTTP.
        headers: of the answer.
    """

    def __init__(
        self,
        status: int,
        message: str,
        *,
        code: str,
        fields: Sequence[str] = (),
        headers: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(message, code=code, fields=fields)
        self.status = status
        self.headers = dict(headers or {})


def answer_problems(app: FastAPI) -> None:
    """Have an application answer every error as JSON, never with a traceback."""
    app.add_exception_handler(FusionSlamError, _answer_known)
    app.add_exception_handler(RequestValidationError, _answer_invalid)
    app.add_exception_handler(HTTPException, _answer_http)
    app.add_exception_handler(ClientDisconnect, _answer_nobody)
    app.add_exception_handler(Exception, _answer_unknown)


def problem_json(
    status: int,
    code: str,
    message: str,
    fields: Sequence[str] = (),
    headers: Mapping[str, str] | None = None,
) -> JSONResponse:
    """Return the answer to a request that failed."""
    content = {"code": code, "message": message, "fields": list(fields)}
    return JSONResponse(content, status, dict(headers or {}))


async def _answer_known(request: Request, error: Exception) -> JSONResponse:
    """Answer bad data and bad values with 422, a ``RequestError`` with its own status."""
    assert isinstance(error, FusionSlamError)
    if isinstance(error, RequestError):
        return problem_json(error.status, error.code, str(error), error.fields, error.headers)
    return problem_json(422, error.code, one_line(error), error.fields)


async def _answer_invalid(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, RequestValidationError)
    first: Mapping[str, Any] = error.errors()[0]
    where = ".".join(str(part) for part in first["loc"][1:])
    return problem_json(422, "parameter", f"{where}: {reason_of(first)}", (where,))


async def _answer_http(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)
    code = _CODES.get(error.status_code, "http")
    return problem_json(error.status_code, code, str(error.detail), (), error.headers)


async def _answer_nobody(request: Request, error: Exception) -> JSONResponse:
    """Answer a client that went away while it sent its body; only metrics see it."""
    return problem_json(400, "gone", "the client closed the connection")


async def _answer_unknown(request: Request, error: Exception) -> JSONResponse:
    logger.error("%s %s failed", request.method, request.url.path, exc_info=error)
    return problem_json(500, "internal", "this is an error of the service; its log has the reason")
