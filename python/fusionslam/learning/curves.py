# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Training curves: loss and scores by epoch, as a table and as a figure."""

import csv
from collections.abc import Sequence
from pathlib import Path

from fusionslam.errors import FusionSlamError
from fusionslam.storage.files import atomic_path

Row = dict[str, float]
"""Epoch, loss and scores by name."""


def write_curves(folder: Path, rows: Sequence[Row]) -> None:
    """Write curves.csv and curves.png.

    Raises:
        DataError: the files cannot be written.
        FusionSlamError: matplotlib is not installed.
    """
    with atomic_path(folder / "curves.csv") as path, path.open("w", newline="") as stream:
        table = csv.DictWriter(stream, list(rows[0]))
        table.writeheader()
        table.writerows(rows)
    _draw(folder / "curves.png", rows)


def _draw(target: Path, rows: Sequence[Row]) -> None:
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise FusionSlamError(
            "curves need matplotlib, which is not installed: pip install 'fusionslam[report]'"
        ) from error
    names = [name for name in rows[0] if name != "epoch"]
    figure = Figure(figsize=(3.6 * len(names), 3), layout="constrained")
    for axes, name in zip(figure.subplots(1, len(names), squeeze=False)[0], names, strict=True):
        axes.plot([row["epoch"] for row in rows], [row[name] for row in rows], marker=".")
        axes.set(title=name.replace("_", " "), xlabel="epoch")
        axes.grid(alpha=0.3)
    with atomic_path(target) as path:
        # Without matplotlib's version and time: same curves, same bytes.
        figure.savefig(path, format="png", dpi=100, metadata={"Software": None})
