# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The library's messages on stderr while a command runs."""

import logging
import sys

import typer
from rich.logging import RichHandler

from fusionslam.base.texts import PER_FRAME, counted
from fusionslam.cli.console import stderr
from fusionslam.cli.failures import COMMAND

logger = logging.getLogger(__name__)


class _Filter(logging.Filter):
    """Passes each message once, as data are reopened for each source; counts those of frames.

    Args:
        counts_frames: whether messages about single frames are counted instead of passed.
    """

    def __init__(self, *, counts_frames: bool) -> None:
        super().__init__()
        self._counts_frames = counts_frames
        self._seen: set[str] = set()
        self._frames: dict[str, set[str]] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Tell whether a record passes."""
        message = record.getMessage()
        if message in self._seen:
            return False
        self._seen.add(message)
        text = getattr(record, PER_FRAME, None)
        if text is None or not self._counts_frames:
            return True
        self._frames.setdefault(text, set()).add(message)
        return False

    def report_frames(self) -> None:
        """Say once what was said of frames, with their number."""
        # The contexts close while an error leaves them: then frames were left unread.
        read = "" if sys.exc_info()[0] is None else " of those read until the error"
        for text, messages in self._frames.items():
            count = counted(len(messages), "frame")
            logger.warning("%s%s: %s (--verbose lists them)", count, read, text)


def start_logging(ctx: typer.Context, *, verbose: bool) -> None:
    """Send the library's messages to stderr: warnings and above, or more if verbose.

    What is said of each frame is said once at the end, with the number of frames.
    """
    ctx.meta[COMMAND] = ctx
    handler = RichHandler(console=stderr(), show_path=False, show_time=False)
    once = _Filter(counts_frames=not verbose)
    handler.addFilter(once)
    ctx.call_on_close(once.report_frames)
    level = logging.INFO if verbose else logging.WARNING
    logging.basicConfig(level=level, format="%(message)s", handlers=[handler], force=True)
