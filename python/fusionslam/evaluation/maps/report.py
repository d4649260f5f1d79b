# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``MapReport``: how well a map fits the world it was made in."""

import os
from dataclasses import asdict, dataclass
from typing import Any

from fusionslam.base.archive import check_types, load_json, save_json
from fusionslam.base.argument_types import checked
from fusionslam.base.texts import counted
from fusionslam.evaluation.views.report import percent, share
from fusionslam.evaluation.views.rules import ViewRule
from fusionslam.geometry.rigid import RigidMotion

TRUTH = "truth"
"""Name of odometry that equals the ground truth."""
FORMAT = "fusionslam.map_report.1"


@dataclass(frozen=True)
class PoseErrors:
    """Deviation of poses from the ground truth after the best alignment.

    Attributes:
        n: number of poses.
        rmse_m, mean_m, max_m: metres between positions.
        heading_rmse_deg: degrees between headings.
        motion: the alignment (``motion.apply(run.nodes)``).
    """

    n: int
    rmse_m: float
    mean_m: float
    max_m: float
    heading_rmse_deg: float
    motion: RigidMotion


@checked
@dataclass(frozen=True, kw_only=True)
class MapReport:
    """A judged run of RatSLAM. Figures are None without ground truth.

    Each set of poses is aligned with the ground truth separately: rotated and shifted, not
    scaled. "Every step" is every step from the first node on.

    Attributes:
        name, views, odometry, preset: as in the run.
        steps, looks, seconds: steps judged, those of them with a view, and their duration.
        node_count, link_count: of the final map.
        rule_name, rule: the limits of distance, angle and age that tell places apart.
        nodes: the final nodes against the true pose at the time each was made.
        nodes_by_odometry: dead reckoning at the same times.
        trajectory: every step on the final map (the ATE).
        live: every step on the map at that time, as a robot could have used it.
        dead_reckoning: every step by odometry alone.
        judged_links: links with known ground truth.
        near_links: those whose ends were within each other's view radius when made: the robot's
            true pose at that time, and the target's when the target was made.
        loop_links, near_loop_links: the same counts for links that came from a loop only.
        loops: arrivals at a known node.
        judged_loops, false_loops: loops with known ground truth; those of them where the robot
            was outside the view radius of the node's true place.
        refused, judged_refused, refused_true: refused loops; those with known ground truth; those
            of them that were within the view radius after all.
        refused_linked: those of ``refused_true`` that the map links all the same, as later loops
            agreed with them.
        revisits: looks at the place of an older look (rule: ``loop_age``, ``revisit_distance``).
        linked_revisits: revisits whose node is the node of such an older look, or is linked to
            it.
        unjudged: what could not be judged and why, as text for users.
    """

    name: str
    views: str
    odometry: str
    preset: str
    steps: int
    looks: int
    seconds: float
    node_count: int
    link_count: int
    rule_name: str
    rule: ViewRule
    nodes: PoseErrors | None = None
    nodes_by_odometry: PoseErrors | None = None
    trajectory: PoseErrors | None = None
    live: PoseErrors | None = None
    dead_reckoning: PoseErrors | None = None
    judged_links: int | None = None
    near_links: int | None = None
    loop_links: int | None = None
    near_loop_links: int | None = None
    loops: int = 0
    judged_loops: int | None = None
    false_loops: int | None = None
    refused: int = 0
    judged_refused: int | None = None
    refused_true: int | None = None
    refused_linked: int | None = None
    revisits: int | None = None
    linked_revisits: int | None = None
    unjudged: tuple[str, ...] = ()

    @property
    def remarks(self) -> tuple[str, ...]:
        """What to know before the figures are quoted, as text for users."""
        if self.odometry != TRUTH or self.trajectory is None:
            return self.unjudged
        return (
            "odometry is the ground truth itself: the errors of poses say nothing of a robot's; "
            "--odometry truth+noise adds those of wheels",
            *self.unjudged,
        )

    @property
    def near_link_share(self) -> float | None:
        """Share of the links that join places nearer than the view radius."""
        return _share(self.near_links, self.judged_links)

    @property
    def near_loop_link_share(self) -> float | None:
        """The same share of links from a loop; the others are near by construction."""
        return _share(self.near_loop_links, self.loop_links)

    @property
    def linked_revisit_share(self) -> float | None:
        """Share of the true revisits that are linked on the map."""
        return _share(self.linked_revisits, self.revisits)

    @property
    def false_loop_share(self) -> float | None:
        """Share of the arrivals at a known node while the robot was elsewhere."""
        return _share(self.false_loops, self.judged_loops)

    def metrics(self) -> dict[str, Any]:
        """All figures, ready for JSON; undefined ones are null."""
        figures = asdict(self)
        figures["rule"] = self.rule.model_dump(mode="json")
        shares = ("near_link", "near_loop_link", "linked_revisit", "false_loop")
        return figures | {f"{one}_share": getattr(self, f"{one}_share") for one in shares}

    def __str__(self) -> str:
        heading = [
            f"{self.name}: views {self.views}, odometry {self.odometry}, preset {self.preset}",
            f"{self.seconds:.1f} s and {counted(self.steps, 'step')} from the first node on, "
            f"{counted(self.looks, 'look')}; "
            f"{counted(self.node_count, 'node')}, {counted(self.link_count, 'link')}",
        ]
        return "\n".join([*heading, *_errors(self), *_topology(self), *self.remarks])

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write JSON, whole or not at all. Raises DataError where that is impossible."""
        save_json(path, FORMAT, self.metrics(), indent=2)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "MapReport":
        """Read what ``save`` wrote.

        Raises:
            DataError: the file is missing, truncated or of another kind; the message names it.
        """
        with load_json(path, FORMAT, "a stored map report") as content:
            kept = {key: value for key, value in content.items() if not key.endswith("_share")}
            for name in _ERRORS:
                if kept[name] is not None:
                    motion = RigidMotion(*kept[name].pop("motion"))
                    kept[name] = check_types(PoseErrors(**kept[name], motion=check_types(motion)))
            kept["rule"] = ViewRule(**kept["rule"])
            kept["unjudged"] = tuple(kept["unjudged"])
            return check_types(cls(**kept))


_ERRORS = {
    "nodes": "nodes, when made",
    "nodes_by_odometry": "  dead reckoning then",
    "trajectory": "trajectory, final map",
    "live": "trajectory, live",
    "dead_reckoning": "  dead reckoning",
}
"""Pose sets compared with the truth: attribute -> name in the table."""


def _share(part: int | None, whole: int | None) -> float | None:
    return None if part is None or whole is None else share(part, whole)


def _errors(report: MapReport) -> list[str]:
    found = [(title, getattr(report, name)) for name, title in _ERRORS.items()]
    if all(errors is None for _, errors in found):
        return []
    lines = [f"  {'aligned with the truth':<24}{'poses':>7}{'RMSE':>10}{'max':>10}{'heading':>11}"]
    for title, errors in found:
        if errors is not None:
            lines.append(
                f"  {title:<24}{errors.n:>7}{errors.rmse_m:>8.3f} m{errors.max_m:>8.3f} m"
                f"{errors.heading_rmse_deg:>7.2f} deg"
            )
    return lines


def _topology(report: MapReport) -> list[str]:
    if report.near_links is None:
        return [
            f"  {counted(report.loops, 'arrival')} at known nodes, "
            f"{counted(report.refused, 'loop')} refused"
        ]
    rule, linked = report.rule, report.refused_linked or 0
    refused = f"{(report.refused_true or 0) - linked} of {report.judged_refused} wrongly refused"
    if linked:
        refused += f", {linked} linked later"
    return [
        f"  near means within {rule.loop_distance:g} m and {rule.loop_angle:.3g} deg",
        f"  near links      {percent(report.near_link_share):>8}   {report.near_links} of "
        f"{report.judged_links}",
        f"  right loops     {percent(report.near_loop_link_share):>8}   "
        f"{report.near_loop_links} of {report.loop_links} links that an arrival made",
        f"  linked revisits {percent(report.linked_revisit_share):>8}   "
        f"{report.linked_revisits} of {report.revisits}",
        f"  false arrivals  {percent(report.false_loop_share):>8}   {report.false_loops} of "
        f"{report.judged_loops}, at known nodes",
        f"  refused loops   {report.refused:>8}   {refused}",
    ]
