# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What do false loops do to a map? A share of the views is replaced by known ones from elsewhere,
on odometry that drifts, with and without the test of consistency, and with the original's map.

python -m benchmarks.accuracy.ratslam_false_loops            # the table
python -m benchmarks.accuracy.ratslam_false_loops --write    # into the docs, with a picture
python -m benchmarks.accuracy.ratslam_false_loops --world warehouse
"""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.accuracy.markdown import table, write_between
from benchmarks.accuracy.ratslam_courses import Course, courses, with_false_matches
from benchmarks.accuracy.ratslam_maps import PAGE, PICTURES
from fusionslam.config import merged
from fusionslam.evaluation import MapReport, judge_map
from fusionslam.geometry.odometry_noise import DRIFT
from fusionslam.ratslam import RatSlamConfig
from fusionslam.report.page.figures import CURVE_COLORS, new_figure, use_style

SHARES = (0.0, 0.05, 0.1, 0.2, 0.5)
SEEDS = range(3)
WORLDS = ("warehouse", "simulated house")
WAYS: Mapping[str, RatSlamConfig] = {
    "robust": RatSlamConfig(preset="robust"),
    "robust, loops unchecked": merged(RatSlamConfig(preset="robust"), {"map": {"sigmas": 1e6}}),
    "openratslam": RatSlamConfig(preset="openratslam"),
}
HEADER = ["world", "false views", *(f"{way}: RMSE" for way in WAYS)]
HEADER += [f"{way}: false arrivals" for way in WAYS] + ["robust: refused", "true ones among them"]


@dataclass(frozen=True)
class Outcome:
    """What came of some share of wrong views, by way and by seed."""

    world: str
    share: float
    wrong: float
    reports: Mapping[str, Sequence[MapReport]]

    def rmse(self, way: str) -> list[float]:
        """Metres, of the nodes, by seed."""
        return [report.nodes.rmse_m for report in self.reports[way] if report.nodes is not None]

    @property
    def dead_reckoning(self) -> float:
        """Metres."""
        first = self.reports["robust"][0].dead_reckoning
        return float("nan") if first is None else first.rmse_m


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--world", help="names of worlds, with commas between them")
    parser.add_argument("--write", action="store_true", help="put table and picture into docs/")
    arguments = parser.parse_args()
    worlds = arguments.world.split(",") if arguments.world else WORLDS
    found = [
        outcome(course, share) for course in courses(worlds, ["alignment"]) for share in SHARES
    ]
    text = table(HEADER, [cells_of(one) for one in found])
    print(text)
    if arguments.write:
        draw(found)
        write_between(PAGE, "ratslam-false-loops", text)


def outcome(course: Course, share: float) -> Outcome:
    """A share of wrong views on a course; without any, all seeds are one."""
    told = [with_false_matches(course, share, seed) for seed in (SEEDS if share else SEEDS[:1])]
    reports = {
        way: [judge_map(course.run(config, DRIFT, sightings)) for sightings, _ in told]
        for way, config in WAYS.items()
    }
    print(f"{course.drive.name}: {share:.0%} done", flush=True)
    return Outcome(course.drive.name, share, float(np.mean([wrong for _, wrong in told])), reports)


def cells_of(one: Outcome) -> list[str]:
    """The means of the seeds."""
    robust = one.reports["robust"]
    rmse = [f"{np.mean(one.rmse(way)):.3f} m" for way in WAYS]
    false = [f"{np.mean([r.false_loops or 0 for r in one.reports[way]]):.0f}" for way in WAYS]
    refused = [f"{np.mean([r.refused for r in robust]):.0f}"]
    refused += [f"{np.mean([r.refused_true or 0 for r in robust]):.0f}"]
    return [one.world, f"{one.share:.0%}, {one.wrong:.0f}", *rmse, *false, *refused]


def draw(found: Sequence[Outcome]) -> None:
    """RMSE over the share of wrong views, a panel for each world."""
    worlds = list(dict.fromkeys(one.world for one in found))
    with use_style():
        figure = new_figure(4.2 * len(worlds), 3.8)
        panels = figure.subplots(1, len(worlds), squeeze=False, sharey=True)[0]
        for axis, world in zip(panels, worlds, strict=True):
            rows = [one for one in found if one.world == world]
            shares = [100 * one.share for one in rows]
            for way, color in zip(WAYS, CURVE_COLORS, strict=False):
                errors = [one.rmse(way) for one in rows]
                axis.plot(shares, [np.mean(e) for e in errors], "o-", color=color, label=way)
                ends = [min(e) for e in errors], [max(e) for e in errors]
                axis.fill_between(shares, *ends, color=color, alpha=0.2, lw=0)
            reckoned = rows[0].dead_reckoning
            axis.axhline(reckoned, color="#333333", lw=1, ls="--", label="dead reckoning")
            axis.set(title=world, xlabel="false views (%)", yscale="log")
        panels[0].set_ylabel("RMSE of nodes (m)")
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
        figure.savefig(PICTURES / "ratslam_false_loops.png", format="png", dpi=80)


if __name__ == "__main__":
    main()
