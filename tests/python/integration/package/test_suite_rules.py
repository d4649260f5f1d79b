# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The rules that the suite's own plugin keeps, and tables of rows."""

import logging
import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import pytest

from project import SUPPORT
from rows import rows

HEAD = """
import importlib, multiprocessing, os, subprocess, sys, time
from pathlib import Path
import pytest

HERE = Path(__file__).parent

def burn(seconds):
    begun = time.process_time()
    while time.process_time() - begun < seconds:
        pass
"""
# Run with a limit of 0.2 s, which is a sixth of that for unit tests.
INTEGRATION = """
def test_long():
    burn(0.25)

@pytest.mark.slow
def test_slow():
    burn(0.25)

@pytest.mark.nightly
def test_nightly():
    burn(0.25)

def test_sleeping():
    time.sleep(0.25)

def test_child_that_works():
    subprocess.run([sys.executable, "-c", f"import time\\nwhile time.process_time() < 0.25: pass"])

@pytest.fixture
def heavy():
    burn(0.25)

def test_heavy_fixture(heavy):
    pass

def test_first_import():
    import heavy_statement

def test_first_import_by_a_function():
    importlib.import_module("heavy_function")

def test_first_import_from_a_package():
    from package import heavy_part

def test_process():
    subprocess.run(["true"])
    (HERE / "written").write_text("")
"""
UNIT = """
def test_long():
    burn(0.1)

@pytest.mark.slow
def test_slow():
    burn(0.1)

@pytest.mark.nightly
def test_nightly():
    burn(0.1)

def test_failing_long():
    burn(0.1)
    raise ValueError("its own reason")

def test_process():
    subprocess.run(["true"])

def test_fork():
    if not os.fork():
        os._exit(0)
    os.wait()

def test_spawn():
    multiprocessing.get_context("spawn").Process(target=print).start()

def test_file():
    (HERE / "written").write_text("")

def test_file_of_its_own(tmp_path):
    (tmp_path / "written").write_text((HERE / "test_rules.py").read_text())
"""
SLOW_IMPORT = (
    "import time\nbegun = time.process_time()\nwhile time.process_time() < begun + 0.25: pass"
)


def make_project(folder: Path) -> Path:
    """A suite with a test for each rule, beside a copy of the plugin."""
    tests = folder / "project" / "tests/python"
    for name, source in {
        "integration/test_rules.py": HEAD + INTEGRATION,
        "unit/test_rules.py": HEAD + UNIT,
        "support/heavy_statement.py": SLOW_IMPORT,
        "support/heavy_function.py": SLOW_IMPORT,
        "support/package/__init__.py": "",
        "support/package/heavy_part.py": SLOW_IMPORT,
    }.items():
        (tests / name).parent.mkdir(parents=True, exist_ok=True)
        (tests / name).write_text(source)
    shutil.copy2(SUPPORT / "suite.py", tests / "support")
    (folder / "project" / "pytest.ini").write_text(
        "[pytest]\naddopts = -p suite --import-mode=importlib --strict-markers\n"
        "pythonpath = tests/python/support\n"
        "markers =\n  unit\n  integration\n  system\n  slow\n  nightly\n"
    )
    return folder / "project"


def run_tests(project: Path, *options: str) -> "subprocess.CompletedProcess[str]":
    """Run a suite in a process whose temporary folder is beside the project."""
    temporary = project.with_name("temporary")
    temporary.mkdir(exist_ok=True)
    limits = ["--processor-limit=0.2", f"--junitxml={temporary / 'results.xml'}"]
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *limits, *options],
        cwd=project,
        env={
            **os.environ,
            "TMPDIR": str(temporary),
            "PYTHONPATH": "tests/python/support",
            "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
        },
        capture_output=True,
        text=True,
    )


def results_of(project: Path) -> dict[str, str]:
    """What pytest says of each test: nothing if it passed."""
    cases = ElementTree.parse(project.with_name("temporary") / "results.xml").iter("testcase")
    return {
        f"{case.get('classname', '').split('.')[2]} {case.get('name')}": "".join(
            failure.get("message", "") + (failure.text or "") for failure in case
        )
        for case in cases
    }


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    project = make_project(tmp_path_factory.mktemp("suite"))
    done = run_tests(project)
    assert done.returncode == 1, done.stdout + done.stderr
    return results_of(project)


@rows(
    "test, reason",
    [
        ("integration test_long", r"0\.[2-9]\d* s of processor time, more than 0\.2 s"),
        ("integration test_child_that_works", r"0\.[2-9]\d* s of processor time"),
        ("unit test_long", r"more than 0\.033 s"),
        ("unit test_slow", r"more than 0\.033 s"),
        ("unit test_failing_long", "its own reason"),
        ("unit test_process", "a unit test does not do this: subprocess.Popen"),
        ("unit test_fork", "a unit test does not do this: os.fork"),
        ("unit test_spawn", "a unit test does not do this: multiprocessing"),
        ("unit test_file", "a unit test does not do this: write .*written"),
    ],
)
def test_what_a_test_may_not_do_fails_it_with_the_reason(
    results: dict[str, str], test: str, reason: str
) -> None:
    assert re.search(reason, results[test])


@rows(
    "test",
    [
        *("integration test_slow", "integration test_nightly", "integration test_sleeping"),
        *("integration test_heavy_fixture", "integration test_process"),
        *("integration test_first_import", "integration test_first_import_by_a_function"),
        *("integration test_first_import_from_a_package", "unit test_nightly"),
        "unit test_file_of_its_own",
    ],
)
def test_what_a_test_may_do_passes(results: dict[str, str], test: str) -> None:
    assert results[test] == ""


def test_the_limit_can_be_lifted_and_folders_are_marks(tmp_path: Path) -> None:
    project = make_project(tmp_path)
    done = run_tests(project, "--processor-limit=0", "-m", "integration", "-k", "long")
    assert done.returncode == 0, done.stdout
    assert results_of(project) == {"integration test_long": ""}


def test_a_file_outside_of_the_tiers_is_refused(tmp_path: Path) -> None:
    project = make_project(tmp_path)
    (project / "tests/python/test_stray.py").write_text("def test_it(): pass")
    done = run_tests(project, "tests/python/test_stray.py")
    assert done.returncode == pytest.ExitCode.USAGE_ERROR
    assert "test_stray.py is in none of the folders unit, integration, system" in done.stderr


# Tables


@dataclass
class Seen:
    """What the rows of a table saw."""

    paths: list[Path]
    values: list[str | None]


def run_rows(table: list[int], **fixtures: object) -> Seen:
    """Rows that fail, skip or pass; what each finds of fixtures that the one before changed."""
    seen = Seen([], [])

    @rows("number", table)
    def test(number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        seen.paths.append(tmp_path)
        seen.values.append(os.environ.get("FUSIONSLAM_ROW"))
        monkeypatch.setenv("FUSIONSLAM_ROW", str(number))
        if number == 1:
            raise ValueError("one")
        if number == 2:
            pytest.fail("two")
        if number == 3:
            pytest.skip("three")

    test(**fixtures)
    return seen


def test_every_row_that_fails_is_reported_with_its_values(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ExceptionGroup, match="2 of 4 rows") as caught:
        run_rows([0, 1, 3, 2], tmp_path=tmp_path, monkeypatch=monkeypatch)
    assert [str(each) for each in caught.value.exceptions] == ["one", "two"]
    assert [each.__notes__ for each in caught.value.exceptions] == [
        ["row 1: {'number': 1}"],
        ["row 3: {'number': 2}"],
    ]


def test_each_row_has_a_folder_of_its_own_and_nothing_patched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = run_rows([0, 3, 4], tmp_path=tmp_path, monkeypatch=monkeypatch)
    assert seen.values == [None] * 3 and "FUSIONSLAM_ROW" not in os.environ
    assert len(set(seen.paths)) == 3 and all(path.is_dir() for path in seen.paths)


def test_a_table_of_skipped_rows_is_skipped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(pytest.skip.Exception, match="three"):
        run_rows([3, 3], tmp_path=tmp_path, monkeypatch=monkeypatch)


@rows("word", ["one", "two"])
def test_output_and_records_of_a_row_are_its_own(
    word: str, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    print(word)
    logging.warning(word)
    assert capsys.readouterr().out == f"{word}\n"
    assert caplog.messages == [word]


def test_tables_without_rows_or_with_too_few_values_are_refused() -> None:
    with pytest.raises(AssertionError, match="no rows"):
        rows("number", [])
    with pytest.raises(ValueError):
        rows("number, word", [(1,)])
