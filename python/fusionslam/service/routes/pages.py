# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The page that shows sites and finds clouds; it asks the other routes for all that it shows."""

from importlib.resources import files

from fastapi import APIRouter, Response

from fusionslam.service.problems import RequestError

router = APIRouter(include_in_schema=False)
_PAGE = files("fusionslam.service") / "page"
_FILES = {
    "page.css": (_PAGE / "page.css", "text/css"),
    "page.js": (_PAGE / "page.js", "text/javascript"),
    "map.js": (_PAGE / "map.js", "text/javascript"),
    # The look of all pages of fusionslam.
    "style.css": (files("fusionslam") / "report" / "page" / "templates" / "style.css", "text/css"),
}
_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' data:; form-action 'none'; "
    "frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-cache",
}


@router.get("/")
@router.get("/sites/{site:path}")
async def show_page() -> Response:
    """Return the page; its script reads from the address which site is meant."""
    page = (_PAGE / "index.html").read_bytes()
    return Response(page, media_type="text/html; charset=utf-8", headers=_HEADERS)


@router.get("/page/{name}")
async def show_file(name: str) -> Response:
    """Return a script or a style of the page."""
    if name not in _FILES:
        raise RequestError(404, f"the page has no file {name!r}", code="no-such-page")
    path, kind = _FILES[name]
    return Response(path.read_bytes(), media_type=kind, headers=_HEADERS)
