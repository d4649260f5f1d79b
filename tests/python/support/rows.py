# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of tables: one test runs over all its rows and reports each row that fails."""

import inspect
import logging
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from functools import wraps
from pathlib import Path
from typing import Any

import pytest

Test = Callable[..., None]


def rows(names: str, table: Iterable[Any]) -> Callable[[Test], Test]:
    """Run a test once for each row of a table, as one test.

    It is written as ``pytest.mark.parametrize`` is, and costs one case instead of one for each row.
    Each row has its own ``tmp_path``, an empty ``caplog`` and ``capsys``, and gets back what
    ``monkeypatch`` changed; other fixtures are shared by all rows, so rows must not change them.
    A row that is skipped skips no other; if all are, the test is.

    Args:
        names: of the parameters that a row fills, with commas between them.
        table: rows, each with a value for each name; plain values where there is one name.

    Raises:
        ExceptionGroup: of what failed, each with the row beside it.
    """
    parameters = [name.strip() for name in names.split(",")]
    cases = [
        dict(zip(parameters, [case] if len(parameters) == 1 else case, strict=True))
        for case in table
    ]
    assert cases, f"no rows for {names}"

    def decorate(test: Test) -> Test:
        signature = inspect.signature(test)

        @wraps(test)
        def run(**fixtures: Any) -> None:
            problems: list[Exception] = []
            skipped: list[BaseException] = []
            for number, values in enumerate(cases):
                with ExitStack() as stack:
                    try:
                        test(**_fixtures_of_row(fixtures, number, stack), **values)
                    except pytest.skip.Exception as reason:
                        skipped.append(reason)
                    except (Exception, pytest.fail.Exception) as problem:
                        problem.add_note(f"row {number}: {values}")
                        problems.append(_as_exception(problem))
            if problems:
                text = f"{len(problems)} of {len(cases)} rows of {test.__name__} failed"
                raise ExceptionGroup(text, problems)
            if len(skipped) == len(cases):
                raise skipped[0]

        kept = [each for name, each in signature.parameters.items() if name not in parameters]
        run.__signature__ = signature.replace(parameters=kept)  # type: ignore[attr-defined]
        return run

    return decorate


def grouped(table: Mapping[Any, Iterable[Any]]) -> list[tuple[Any, Any]]:
    """Rows of a table that lists all values that have something in common, as a code, by that."""
    return [(key, value) for key, values in table.items() for value in values]


def _fixtures_of_row(fixtures: dict[str, Any], number: int, stack: ExitStack) -> dict[str, Any]:
    """The fixtures, those that a row may change as they were before the first row."""
    own = dict(fixtures)
    if isinstance(folder := fixtures.get("tmp_path"), Path):
        own["tmp_path"] = folder / f"row-{number}"
        own["tmp_path"].mkdir()
    if "monkeypatch" in fixtures:
        own["monkeypatch"] = stack.enter_context(fixtures["monkeypatch"].context())
    if "caplog" in fixtures:
        logging.getLogger().addHandler(fixtures["caplog"].handler)  # if a command took it away
        fixtures["caplog"].clear()
    if "capsys" in fixtures:
        fixtures["capsys"].readouterr()
    return own


def _as_exception(problem: BaseException) -> Exception:
    """The problem itself, or what ``pytest.fail`` raised as an exception that can be grouped."""
    if isinstance(problem, Exception):
        return problem
    failed = AssertionError(str(problem))
    failed.__notes__ = problem.__notes__
    return failed.with_traceback(problem.__traceback__)
