# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A training loop that can be stopped at any time and resumes with the same result."""

import csv
import json
import math
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from fusionslam.base.archive import join_parts, load_archive, part_of, save_archive
from fusionslam.base.files import atomic_path, reading
from fusionslam.config import Section, flatten, option
from fusionslam.errors import ConfigError, DataError, FusionSlamError
from fusionslam.learning.torch_extra import nn, torch

FORMAT = "fusionslam.training.2"
CHECKPOINT = "checkpoint.pt"
"""An archive; the name is that of version 1, which torch wrote."""

Row = dict[str, float]
"""Epoch, loss and scores by name."""

Progress = Callable[[int, int, Mapping[str, float]], None]


class OptimiserConfig(Section):
    """Adam with a cosine learning rate schedule, used by every training here."""

    seed: int = option(0, "seed of initial weights, batches and augmentation", ge=0, lt=2**32)
    epochs: int = option(10, "passes over the data", ge=1)
    learning_rate: float = option(1e-3, "at the start", gt=0)
    weight_decay: float = option(1e-4, "L2 penalty of the weights", ge=0)


class Task(Protocol):
    """The network, data and loss of a training."""

    network: nn.Module

    def losses(self, rng: np.random.Generator) -> Iterator[torch.Tensor]:
        """The loss of each batch of one epoch."""

    def scores(self) -> dict[str, float]:
        """Scores of the network on held-out data."""


@dataclass(frozen=True)
class Trained:
    """A finished training: loss, scores and CPU seconds of each epoch."""

    rows: tuple[Row, ...]
    seconds: tuple[float, ...]

    @property
    def scores(self) -> dict[str, float]:
        """Loss and scores of the last epoch."""
        return dict(self.rows[-1])

    @property
    def cpu_seconds(self) -> float:
        """CPU seconds of all epochs, including those before an interruption."""
        return sum(self.seconds)


@contextmanager
def seed_torch(seed: int) -> Iterator[None]:
    """Run torch on one thread with a seed; restores threads and random state at the end."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            yield
    finally:
        torch.set_num_threads(threads)


def train(
    task: Task,
    config: OptimiserConfig,
    folder: str | os.PathLike[str],
    about: Mapping[str, Any],
    progress: Progress | None = None,
) -> Trained:
    """Train, or resume where an earlier call with the same settings stopped.

    After every epoch the folder has a checkpoint and the curves so far; an interrupted epoch is
    repeated with the same random numbers.

    Args:
        task: network, data and loss.
        config: configuration of the optimiser.
        folder: for checkpoint.pt, curves.csv and curves.png.
        about: settings and data as JSON values, to refuse the checkpoint of another training.
        progress: called with epochs done, total epochs, and the last epoch's loss and scores.

    Raises:
        ConfigError: the folder has a checkpoint of other settings or data.
        DataError: the checkpoint is damaged, or the loss is no longer finite.
    """
    place = Path(folder)
    run = _Run(task, config, json.dumps(dict(about), sort_keys=True))
    rows, seconds = run.resume(place / CHECKPOINT)
    for epoch in range(len(rows), config.epochs):
        begin = time.process_time()
        rows.append(run.epoch(epoch))
        seconds.append(time.process_time() - begin)
        run.save(place / CHECKPOINT, rows, seconds)
        _write_curves(place, rows)
        if progress is not None:
            progress(epoch + 1, config.epochs, rows[-1])
    task.network.eval()
    return Trained(tuple(rows), tuple(seconds))


class _Run:
    """The state of a training: network and optimiser."""

    def __init__(self, task: Task, config: OptimiserConfig, about: str) -> None:
        self.task, self.config, self.about = task, config, about
        self.optimiser = torch.optim.Adam(
            task.network.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay
        )

    def epoch(self, number: int) -> Row:
        """Train for one epoch."""
        share = number / self.config.epochs
        for group in self.optimiser.param_groups:
            group["lr"] = self.config.learning_rate * 0.5 * (1 + math.cos(math.pi * share))
        rng = np.random.default_rng([self.config.seed, number])
        total, count = 0.0, 0
        self.task.network.train()
        with seed_torch(int(rng.integers(2**62))):
            for loss in self.task.losses(rng):
                self.optimiser.zero_grad()
                loss.backward()  # type: ignore[no-untyped-call]
                self.optimiser.step()
                total, count = total + float(loss.detach()), count + 1
            self.task.network.eval()
            scores = self.task.scores()
        if not math.isfinite(total):
            raise DataError(
                f"epoch {number + 1}: the loss is not finite; expected a lower learning rate than "
                f"{self.config.learning_rate:g}",
                code="not-finite",
            )
        return {"epoch": number + 1.0, "loss": total / max(count, 1), **scores}

    def save(self, path: Path, rows: list[Row], seconds: list[float]) -> None:
        """Write the checkpoint atomically."""
        optimiser = self.optimiser.state_dict()
        about = {
            "about": self.about,
            "rows": rows,
            "seconds": seconds,
            "groups": optimiser["param_groups"],
        }
        state = {str(number): values for number, values in optimiser["state"].items()}
        parts = {"network": self.task.network.state_dict(), "optimiser": join_parts(state)}
        tensors = join_parts(parts)
        save_archive(path, FORMAT, about, {name: t.numpy() for name, t in tensors.items()})

    def resume(self, path: Path) -> tuple[list[Row], list[float]]:
        """Load a checkpoint, if there is one, and return its rows and seconds."""
        if not path.exists():
            return [], []
        expected = "a checkpoint of a training by this version; take another folder to begin anew"
        with load_archive(path, FORMAT, expected) as (about, arrays):
            difference = _difference(about["about"], self.about)
        if difference:
            raise ConfigError(
                f"{path} is of a training with other settings or data: {difference}; take another "
                "folder",
                code="other-settings",
                fields=[str(path)],
            )
        with reading(path, expected):
            tensors = {name: torch.from_numpy(rows) for name, rows in arrays.items()}
            network = part_of(tensors, "network")
            state: dict[int, dict[str, torch.Tensor]] = {}
            for name, tensor in part_of(tensors, "optimiser").items():
                number, _, value = name.partition(".")
                state.setdefault(int(number), {})[value] = tensor
            self.task.network.load_state_dict(network)
            self.optimiser.load_state_dict({"state": state, "param_groups": about["groups"]})
            return list(about["rows"]), list(about["seconds"])


def _difference(before: str, now: str) -> str:
    """The first difference between two settings; empty if there is none."""
    old, new = (flatten(json.loads(text)) for text in (before, now))
    for key in sorted(old.keys() | new.keys()):
        if old.get(key) != new.get(key):
            return f"{key} is {old.get(key)!r} there and {new.get(key)!r} here"
    return ""


def _write_curves(folder: Path, rows: Sequence[Row]) -> None:
    """Write curves.csv and curves.png.

    Raises:
        DataError: the files cannot be written.
        FusionSlamError: matplotlib is not installed.
    """
    with atomic_path(folder / "curves.csv") as path, path.open("w", newline="") as stream:
        table = csv.DictWriter(stream, list(rows[0]))
        table.writeheader()
        table.writerows(rows)
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
    with atomic_path(folder / "curves.png") as path:
        # Without matplotlib's version and time: same curves, same bytes.
        figure.savefig(path, format="png", dpi=100, metadata={"Software": None})
