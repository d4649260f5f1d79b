# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Entry point of the ``fusionslam`` command; Ctrl-C exits quietly even while modules load."""

import os
import signal

INTERRUPTED = 130


def main() -> None:
    """Run the command line."""
    before = signal.signal(signal.SIGINT, lambda *_: os._exit(INTERRUPTED))
    from fusionslam.cli import app

    signal.signal(signal.SIGINT, before)
    # A recording ended by kill or by a service manager must keep its complete part, too.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    app(prog_name="fusionslam")


if __name__ == "__main__":
    main()
