# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The suite's own rules, as a plugin of pytest.

The folder of a test is its tier and mark. A test of the tier ``unit`` starts no process, writes no
file beyond temporary ones and takes less than 0.2 s; any other takes less than 2 s unless it is
marked ``slow``. Tests of the nights may take any time. Seconds are processor time of the test
itself, without fixtures, the first import of modules and the collection of what earlier tests left,
of the tier ``unit`` without other threads, which may be those of earlier tests: they depend little
on what else a machine does, or on the order of tests. Little: so that none fails by chance, a test
fails from 3 s on, one of the tier ``unit`` from 0.5 s on.
"""

import gc
import importlib
import multiprocessing.process
import os
import resource
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

TESTS = Path(__file__).resolve().parents[1]
TIERS = ("unit", "integration", "system")
_SHARE_OF_UNIT = 1 / 6
_STARTED = "multiprocessing.Process.start"  # spawning one raises no event of Python's own
_PROCESSES = ("subprocess.Popen", "os.fork", "os.forkpty", "os.posix_spawn", "os.system", _STARTED)
_WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--processor-limit",
        type=float,
        default=3.0,
        metavar="S",
        help="seconds at which an unmarked test fails; 0: no limit, as under a sanitizer",
    )


def pytest_configure(config: pytest.Config) -> None:
    # So that what fails in them shows its values.
    modules = {each.stem for each in Path(__file__).parent.glob("*.py")}
    pytest.register_assert_rewrite(*(modules - {*sys.modules}))
    if config.option.basetemp:
        _allowed.append(os.path.abspath(config.option.basetemp))
    _imports.watch()
    _collections.watch()
    _tell_of_processes()
    sys.addaudithook(_audit)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark each test with its tier; pages of the documentation are of the tier system."""
    for item in items:
        item.add_marker(tier_of(item.path))


def tier_of(path: Path) -> str:
    """The tier of a file by its folder."""
    if path.is_relative_to(TESTS):
        first = path.relative_to(TESTS).parts[0]
        if first not in TIERS:
            raise pytest.UsageError(f"{path} is in none of the folders {', '.join(TIERS)}")
        return first
    return "system"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    """Fail a test that takes too long, or does what its tier may not."""
    is_unit = item.get_closest_marker("unit") is not None
    processor_s = time.thread_time if is_unit else _processor_s
    begun, aside = processor_s(), _imports.seconds + _collections.seconds
    _forbidden.clear()
    _forbidden.active = is_unit
    try:
        result = yield
    finally:
        _forbidden.active = False
        aside = _imports.seconds + _collections.seconds - aside
        seconds = processor_s() - begun - aside
        item.user_properties.append(("processor_s", round(seconds, 3)))
    if _forbidden:
        pytest.fail(f"a unit test does not do this: {_forbidden[0]}", pytrace=False)
    _check_seconds(item, seconds, is_unit)
    return result


def _check_seconds(item: pytest.Item, seconds: float, is_unit: bool) -> None:
    limit = item.config.getoption("--processor-limit")
    if any(item.iter_markers("nightly")):
        limit = 0
    elif is_unit:
        limit *= _SHARE_OF_UNIT
    elif any(item.iter_markers("slow")):
        limit = 0
    if limit and seconds > limit:
        pytest.fail(
            f"it took {seconds:.2f} s of processor time, more than {limit:.2g} s: make it quicker, "
            "make what it needs an artefact, or mark it slow",
            pytrace=False,
        )


def _processor_s() -> float:
    """Of this process with all its threads, and of the processes that it waited for."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


class _Imports:
    """Sums the processor time of first imports, which another test would have paid otherwise."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self._depth = 0

    def watch(self) -> None:
        """Time what finds and loads a module, whatever statement or function asks for it."""
        system: Any = importlib._bootstrap
        load = system._find_and_load

        def timed(name: str, import_: Any) -> Any:
            if self._depth:
                return load(name, import_)
            self._depth, begun = 1, time.process_time()
            try:
                return load(name, import_)
            finally:
                self._depth = 0
                self.seconds += time.process_time() - begun

        system._find_and_load = timed


class _Collections:
    """Sums the processor time of collections of garbage, which comes from any test."""

    def __init__(self) -> None:
        self.seconds = self._begun = 0.0

    def watch(self) -> None:
        gc.callbacks.append(self._note)

    def _note(self, phase: str, info: dict[str, int]) -> None:
        if phase == "start":
            self._begun = time.thread_time()
        else:
            self.seconds += time.thread_time() - self._begun


class _Forbidden(list[str]):
    """What a unit test did that it may not do."""

    active = False


_imports = _Imports()
_collections = _Collections()
_forbidden = _Forbidden()
_allowed = [tempfile.gettempdir(), os.path.realpath(tempfile.gettempdir()), os.devnull]


def _tell_of_processes() -> None:
    start = multiprocessing.process.BaseProcess.start

    def told(process: multiprocessing.process.BaseProcess) -> None:
        sys.audit(_STARTED, process.name)
        start(process)

    multiprocessing.process.BaseProcess.start = told  # type: ignore[assignment, method-assign]


def _audit(event: str, details: tuple[Any, ...]) -> None:
    if not _forbidden.active:
        return
    if event in _PROCESSES:
        _forbidden.append(f"{event} {details[:1]}")
    elif event == "open" and isinstance(details[0], str | bytes | os.PathLike):
        path, flags = os.path.abspath(os.fsdecode(details[0])), details[2]
        kept = path.startswith(tuple(_allowed)) or "__pycache__" in path or ".hypothesis" in path
        if flags & _WRITES and not kept:
            _forbidden.append(f"write {path}")
