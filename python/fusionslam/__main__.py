# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Where the command ``fusionslam`` starts: quiet when it is interrupted while it still loads."""

import os
import signal

INTERRUPTED = 130


def main() -> None:
    """Run the command line."""
    before = signal.signal(signal.SIGINT, lambda *_: os._exit(INTERRUPTED))
    from fusionslam.cli import app

    signal.signal(signal.SIGINT, before)
    # Who ends a recording by kill or by a service manager wants what is whole kept, too.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    app(prog_name="fusionslam")


if __name__ == "__main__":
    main()
