# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Sizes of a fleet on paper, from costs measured here, and a simulation of arriving drives."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_DAY_S = 86_400.0


@dataclass(frozen=True)
class Costs:
    """What one frame, place or query costs; the defaults were measured (docs/results/fleet.md).

    Attributes:
        describe_s: core seconds to read, fuse and describe a frame, with its cloud.
        row_bytes: of a place in the database, index included.
        cloud_bytes: of a place's cloud and poses in its chunk.
        build_s: seconds to index a million places on two cores.
        build_exponent: of the time to index over the number of places.
        query_s: seconds of a query among a million places.
        query_exponent: of the time of a query over the number of places.
    """

    describe_s: float
    row_bytes: float
    cloud_bytes: float
    build_s: float
    build_exponent: float
    query_s: float
    query_exponent: float

    def describe_core_hours(self, frames: float) -> float:
        """Core hours to describe so many frames."""
        return frames * self.describe_s / 3600

    def database_gb(self, places: float) -> float:
        """Size of the database, 10^9 bytes."""
        return places * self.row_bytes / 1e9

    def clouds_gb(self, places: float) -> float:
        """Size of the clouds, 10^9 bytes."""
        return places * self.cloud_bytes / 1e9

    def build_hours(self, places: float) -> float:
        """Hours to index a database on two cores."""
        return self.build_s * float((places / 1e6) ** self.build_exponent) / 3600

    def query_ms(self, places: float) -> float:
        """Milliseconds of a query."""
        return 1e3 * self.query_s * float((places / 1e6) ** self.query_exponent)


def simulate_arrivals(arrivals_s: Floats, work_s: Floats, workers: int) -> Floats:
    """Return how long each drive waits until all of it is described, float64 (n), seconds.

    Drives are worked on in the order of arrival. A drive is many chunks, so all workers share it,
    and the queue is that of one server that is so many times as fast (Lindley's recursion).

    Args:
        arrivals_s: float64 (n), ascending.
        work_s: float64 (n), core seconds of each drive.
        workers: number of cores.
    """
    waits, backlog, last = np.empty(len(arrivals_s)), 0.0, 0.0
    for row, (arrival, work) in enumerate(zip(arrivals_s, work_s / workers, strict=True)):
        backlog = max(backlog - (arrival - last), 0.0) + work
        waits[row], last = backlog, arrival
    return waits


def arrivals_of_day(
    robots: int, drives: int, days: int, rush: float, rng: np.random.Generator
) -> Floats:
    """Return when drives arrive, ascending, float64 (n), seconds: a share of each day's in an hour.

    Args:
        robots: number of them.
        drives: of each robot a day.
        days: that are simulated.
        rush: share of the drives that arrive in the last hour of a shift, 17 to 18 h.
        rng: random numbers.
    """
    count = robots * drives
    found = []
    for day in range(days):
        at = rng.uniform(8 * 3600, 18 * 3600, count)
        in_rush = rng.random(count) < rush
        at[in_rush] = rng.uniform(17 * 3600, 18 * 3600, int(in_rush.sum()))
        found.append(day * _DAY_S + at)
    return np.sort(np.concatenate(found))


def main(
    robots: Annotated[int, typer.Option(help="Number of robots.")] = 1000,
    drives: Annotated[int, typer.Option(help="Drives of each robot a day.")] = 8,
    frames: Annotated[int, typer.Option(help="Frames of a drive, on average.")] = 3600,
    rush: Annotated[float, typer.Option(help="Share of drives that arrive in one hour.")] = 0.5,
    days: Annotated[int, typer.Option(help="Days that are simulated.")] = 5,
    describe_ms: Annotated[float, typer.Option(help="Core ms a frame.")] = 40.0,
    row_bytes: Annotated[float, typer.Option(help="Bytes a place in the database.")] = 5230.0,
    cloud_kb: Annotated[float, typer.Option(help="kB a place in chunks.")] = 55.0,
    build_s: Annotated[float, typer.Option(help="Seconds to add and index 10^6 places.")] = 104.0,
    build_exponent: Annotated[float, typer.Option(help="Of the time to index.")] = 1.0,
    query_ms: Annotated[float, typer.Option(help="Of a query among 10^6 places.")] = 11.7,
    query_exponent: Annotated[float, typer.Option(help="Of the time of a query.")] = 0.5,
    seeds: Annotated[int, typer.Option(min=1, help="Number of seeds of the arrivals.")] = 5,
) -> None:
    """Print sizes of databases, and how long drives wait until they can be found."""
    costs = Costs(
        describe_ms / 1e3,
        row_bytes,
        1e3 * cloud_kb,
        build_s,
        build_exponent,
        query_ms / 1e3,
        query_exponent,
    )
    _print_sizes(costs)
    print()
    fewest = robots * drives * frames * costs.describe_s / _DAY_S
    print(f"{robots * drives * frames:,} frames a day: {fewest:.1f} cores keep up")
    print("| cores | used | wait, median | wait, 95 % | wait, longest |")
    print("|---|---|---|---|---|")
    for factor in (1.2, 2, 4, 8):
        workers = int(np.ceil(factor * fewest))
        found = [
            simulate_waits(costs, workers, robots, drives, frames, rush, days, seed)
            for seed in range(seeds)
        ]
        cells = [_mean_and_range([waits[k] for waits in found]) for k in range(3)]
        print(f"| {workers} | {fewest / workers:.0%} | {' | '.join(cells)} |")


def _print_sizes(costs: Costs) -> None:
    print("| places | describe, core hours | database, GB | clouds, GB | index, h | query, ms |")
    print("|---|---|---|---|---|---|")
    for places in (1e5, 1e6, 1e7, 1e8):
        cells = (
            f"{costs.describe_core_hours(places):,.0f}",
            f"{costs.database_gb(places):,.1f}",
            f"{costs.clouds_gb(places):,.0f}",
            f"{costs.build_hours(places):.2g}",
            f"{costs.query_ms(places):.2g}",
        )
        print(f"| {places:.0e} | {' | '.join(cells)} |")


def simulate_waits(
    costs: Costs,
    workers: int,
    robots: int,
    drives: int,
    frames: int,
    rush: float,
    days: int,
    seed: int,
) -> tuple[float, float, float]:
    """Return median, 95th percentile and maximum of the waits, minutes; drives differ in length."""
    rng = np.random.default_rng(seed)
    arrivals = arrivals_of_day(robots, drives, days, rush, rng)
    spread = np.exp(rng.normal(0, 0.5, len(arrivals)))
    work = costs.describe_s * frames * spread / spread.mean()
    minutes = simulate_arrivals(arrivals, work, workers) / 60
    median, most, longest = np.percentile(minutes, (50, 95, 100)).tolist()
    return median, most, longest


def _mean_and_range(minutes: list[float]) -> str:
    return f"{np.mean(minutes):.1f} min ({min(minutes):.1f} to {max(minutes):.1f})"


if __name__ == "__main__":
    typer.run(main)
