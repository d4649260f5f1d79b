# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The page of the service, in headless Chromium."""

import hashlib
import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from artefacts import artefact, copy_artefact
from browser import Page, open_browser
from fleet_service import FRAMES, KEY, add_places, scan_at, write_joint_map
from fusionslam.service.config import ServiceConfig
from rows import rows


@pytest.fixture(scope="module")
def page() -> Iterator[Page]:
    with open_browser() as page:
        yield page


@pytest.fixture(scope="module")
def joined(fleet: Path) -> Path:
    """The fleet with another two sessions of the yard, and a joint map that has one of them."""

    def join(folder: Path) -> None:
        places = copy_artefact(fleet, folder / "places")
        for session in ("tuesday", "wednesday"):
            add_places(places, session, 6, site="yard")
        drives = {"yard/robot-1/yard-monday": {0: 0, 3: 0}, "tuesday": {2: 0, 4: 0}}
        write_joint_map(places, "yard", drives)

    return artefact("service-joined", join) / "places"


@pytest.fixture(scope="module")
def urls(fleet: Path, joined: Path) -> Iterator[dict[str, str]]:
    """Addresses of two services of the fleet, one of them with keys; one has a joint map."""
    import uvicorn

    from fusionslam.service.app import create_app
    from fusionslam.service.keys import ApiKeys

    keys = ApiKeys([hashlib.sha256(KEY.encode()).digest()])
    served = {"open": (fleet, ApiKeys()), "locked": (fleet, keys), "joined": (joined, ApiKeys())}
    addresses = {}
    with ExitStack() as stack:
        for name, (folder, given) in served.items():
            app = create_app(folder, ServiceConfig(requests_per_minute=0), given)
            listener = socket.create_server(("127.0.0.1", 0))
            addresses[name] = f"http://127.0.0.1:{listener.getsockname()[1]}"
            server = uvicorn.Server(uvicorn.Config(app, log_level="error"))
            thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
            thread.start()
            stack.callback(thread.join)
            stack.callback(setattr, server, "should_exit", True)
        yield addresses


@pytest.fixture
def scan(tmp_path: Path) -> Path:
    np.save(tmp_path / "scan.npy", scan_at("yard", 1.3))
    return tmp_path / "scan.npy"


def open_map(page: Page, url: str) -> None:
    page.open(url)
    page.wait_for("document.querySelector('#map path[data-session]')")


def drawn(page: Page, kind: str) -> list[str]:
    found = page.run(f"[...document.querySelectorAll('#map {kind}')].map(e => e.getAttribute('d'))")
    return list(found)


def test_the_page_shows_where_a_scan_was_found(
    page: Page, urls: dict[str, str], scan: Path
) -> None:
    open_map(page, f"{urls['open']}/sites/yard")
    assert page.text("h1") == "yard"
    (path,) = drawn(page, "path[data-session]")
    assert path.count("M") == FRAMES and path.startswith("M0 0h0M3 -0.5h0")
    page.choose_file("#scan", scan)
    page.run("document.querySelector('#find').click()")
    page.wait_for("document.querySelector('#map .proven')")
    assert page.text("#answer").startswith("Found on yard at x 3.9 m, y 0.")
    assert page.run("document.querySelectorAll('#candidates tbody tr').length") == 2 * FRAMES
    assert len(drawn(page, ".candidate")) + len(drawn(page, ".best")) == FRAMES
    assert page.messages == []


def test_a_scan_is_found_in_the_joint_map(page: Page, urls: dict[str, str], scan: Path) -> None:
    pytest.importorskip("gtsam", reason="maps are an extra")
    open_map(page, f"{urls['joined']}/sites/yard")
    shown = drawn(page, "path[data-session]:not([hidden])")
    assert sorted(shown) == ["M100 0h0M98.5 -9h0", "M99 -6h0M98 -12h0"]
    assert "1 session is not joined" in page.text("#map-note")
    assert "wednesday (not joined)" in page.text("#legend")
    view = "document.querySelector('#map').getAttribute('viewBox')"
    of_map = page.run(view)
    page.run("[...document.querySelectorAll('#legend input')].find(e => !e.checked).click()")
    assert len(drawn(page, "path[data-session]:not([hidden])")) == 3 and page.run(view) != of_map
    page.choose_file("#scan", scan)
    page.run("document.querySelector('#here').click()")
    page.run("document.querySelector('#find').click()")
    page.wait_for("document.querySelector('#map .proven')")
    assert "y 3.9 m in the joint map: session yard/robot-1/yard-monday" in page.text("#answer")
    x, y = drawn(page, ".proven")[0].removeprefix("M").removesuffix("h0").split()
    assert (float(x), float(y)) == pytest.approx((99.35, -3.9), abs=0.1)
    # Candidates between keyframes lie between them; those of wednesday are not on the map.
    marks = drawn(page, ".candidate") + drawn(page, ".best")
    apart = page.text("#candidates tbody").count("wednesday")
    assert "M99.5 -3h0" in marks and apart and len(marks) == 10 - apart
    assert page.messages == []


def test_a_file_that_is_no_scan_is_named(page: Page, urls: dict[str, str], tmp_path: Path) -> None:
    scan = tmp_path / "scan.ply"
    scan.write_bytes(b"no cloud")
    open_map(page, urls["open"])
    assert page.text("h1") == "depot"  # the first site
    page.choose_file("#scan", scan)
    page.run("document.querySelector('#find').click()")
    page.wait_for("document.querySelector('#answer.problem')")
    assert "cloud.ply" in page.text("#answer")
    page.messages.clear()


def test_the_page_asks_for_a_key(page: Page, urls: dict[str, str]) -> None:
    page.open(urls["locked"])
    page.wait_for("!document.querySelector('#key-form').hidden")
    assert not drawn(page, "path")
    page.run(f"document.querySelector('#key').value = '{KEY}'")
    page.run("document.querySelector('#key-form button').click()")
    page.wait_for("document.querySelector('#map path[data-session]')")
    assert page.run("document.querySelector('#key-form').hidden")
    page.messages.clear()


@rows("dark", [False, True])
def test_the_page_fits_on_a_phone(page: Page, urls: dict[str, str], dark: bool) -> None:
    page.screen(360, 740, dark=dark)
    open_map(page, f"{urls['joined']}/sites/yard")
    assert page.run("document.documentElement.scrollWidth") <= 360
    assert page.run("document.querySelector('#find').getBoundingClientRect().height") >= 40
    color = page.run("getComputedStyle(document.body).backgroundColor")
    shade = sum(int(part) for part in color[4:-1].split(",")) / 3
    assert (shade < 60) == dark and page.messages == []


def test_the_page_of_the_interface_works_offline(page: Page, urls: dict[str, str]) -> None:
    page.open(f"{urls['open']}/docs")
    page.wait_for("document.querySelectorAll('.opblock').length >= 7")
    assert page.messages == []
