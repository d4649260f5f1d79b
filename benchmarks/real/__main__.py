# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Place recognition, loops, localisation and maps on real recordings.

python -m benchmarks.real hku_1
"""

import argparse
from pathlib import Path

from benchmarks.accuracy.data import data_folder
from benchmarks.accuracy.loop_peers import note, run_detector
from benchmarks.accuracy.markdown import table
from benchmarks.real.protocol import Found, judge
from benchmarks.real.recordings import READERS, Recording

HEADER = (
    *("recording", "frames", "revisits", "recall of accepted loops", "at full precision"),
    *("accepted", "wrong", "error: median, m", "95 %, m", "ms a frame"),
)


def find_loops(recording: Recording) -> Found:
    run = run_detector(
        recording.detector(),
        recording.clouds,
        recording.poses,
        stamps_ns=recording.stamps_ns,
        odometry=recording.odometry,
    )
    return judge(run, recording.rule)


def cells(found: Found) -> list[str]:
    return [
        str(found.frames),
        str(found.revisits),
        *("" if value is None else f"{value:.3f}" for value in (found.recall, found.full)),
        str(found.accepted),
        str(found.wrong),
        *(f"{value:.3f}" if found.accepted else "" for value in found.metres),
        f"{found.milliseconds:.0f}",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=list(READERS))
    parser.add_argument("--data", type=Path)
    arguments = parser.parse_args()
    data = arguments.data or data_folder()
    rows = []
    for name in arguments.names:
        file, read = READERS[name]
        if not (data / file).exists():
            note(f"without {name}: {data / file} is not there")
            continue
        rows.append([name, *cells(find_loops(read(data, name)))])
        print(rows[-1], flush=True)
    print(table(HEADER, rows))


if __name__ == "__main__":
    main()
