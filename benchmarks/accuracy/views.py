# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Compares recognisers of places in every frame, as fusionslam bench views does.

python -m benchmarks.accuracy.views                # recordings below FUSIONSLAM_TEST_DATA
python -m benchmarks.accuracy.views DATA ...       # others
python -m benchmarks.accuracy.views --write        # and put the tables into docs/results/views.md
python -m benchmarks.accuracy.views -m objects,cm2dp
"""

import argparse
import os
from pathlib import Path

from benchmarks.accuracy.markdown import write_between
from fusionslam.cli.bench import default_data
from fusionslam.cli.recordings import build_recording
from fusionslam.pipelines.compare_views import bench_views
from fusionslam.pipelines.drives import FRAMES, open_drive
from fusionslam.pipelines.methods import METHODS
from fusionslam.report.views.comparison_tables import markdown
from fusionslam.sim.rendered_images import rendered_images

PAGE = Path(__file__).parents[2] / "docs" / "results" / "views.md"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", nargs="*")
    parser.add_argument("-m", "--methods", default=",".join(METHODS))
    parser.add_argument("--write", action="store_true")
    arguments = parser.parse_args()
    drives = [
        open_drive(build_recording(Path(source)), render=rendered_images)
        for source in arguments.data or default_data()
    ]
    results = bench_views(
        drives, arguments.methods.split(","), frames=list(FRAMES), jobs=os.cpu_count() or 1
    )
    text = markdown(results, {drive.name: drive.dropped for drive in drives})
    print(text)
    if arguments.write:
        write_between(PAGE, "views", text.strip())


if __name__ == "__main__":
    main()
