# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of results that the views commands print."""

from typing import TYPE_CHECKING, Any

from fusionslam.cli.console import print_table
from fusionslam.help_texts import counted

if TYPE_CHECKING:
    from fusionslam.evaluation import ViewReport
    from fusionslam.pipelines.views import MatchRun
    from fusionslam.views.scene_set import SceneSet

HEADS = ("accuracy", "loop recall", "loop precision", "views")


def figures(report: "ViewReport") -> list[str]:
    """Return a run's cells under ``HEADS``."""
    shares = (report.accuracy, report.loop_recall, report.loop_precision)
    texts = ["none" if share is None else f"{100 * share:.1f} %" for share in shares]
    return [*texts, str(report.views)]


def curve_row(curve: Any, name: str, threshold: float | None) -> list[str]:
    """Return a row of the table of thresholds; cells are empty if there is no such threshold."""
    if threshold is None:
        return [name, "none", *("" for _ in HEADS)]
    row = curve.at(threshold)
    names = ("accuracy", "loop_recall", "loop_precision")
    texts = ["none" if row[key] is None else f"{100 * row[key]:.1f} %" for key in names]
    return [name, f"{threshold:.4g}", *texts, f"{row['views']:.0f}"]


def print_run(run: "MatchRun", report: "ViewReport | None") -> None:
    """Print a matcher's results and costs, and its accuracy if there is ground truth."""
    import numpy as np

    stats = run.stats
    times = [
        1000 * float(np.median(each)) if len(each) else 0.0
        for each in (run.build_seconds, run.match_seconds)
    ]
    print(
        f"{counted(stats.processed, 'scan')}: {stats.matched} matched, "
        f"{counted(stats.new, 'place')}, {stats.nothing} with nothing to recognise, "
        f"{stats.single} with a single object{_describe_belief(run)}\n"
        f"{counted(stats.stored, 'view')} stored, {stats.bytes_per_view:.0f} bytes each, "
        f"{stats.dropped} dropped; building {times[0]:.3f} ms, matching {times[1]:.3f} ms (medians)"
    )
    if report is None:
        print("no true poses: the ids are not judged (--gt names a file of poses)")
        return
    rows = [["these matches", *figures(report)], *without_sensor(run.scenes, report.rule_name)]
    print_table(["method", *HEADS], rows)
    print_limits(run.scenes, report.rule_name)


def _describe_belief(run: "MatchRun") -> str:
    if not run.follows_odometry:
        return ""
    stats = run.stats
    return (
        f"\nweighed by odometry: {stats.ambiguous} ambiguous, {stats.by_odometry} at a place that "
        f"the scan did not show, {counted(stats.revised, 'answer')} revised later"
    )


def print_limits(scenes: "SceneSet", rule_name: str) -> None:
    """Print what counts as a loop under a rule, or that no scan comes back."""
    from fusionslam.evaluation import ViewJudge
    from fusionslam.evaluation.views.rules import VIEW_RULES, explain_no_revisit

    rule, poses = VIEW_RULES[rule_name], scenes.true_poses()
    if ViewJudge(poses, scenes.seconds, rule=rule).revisit.any():
        print(
            f"rule {rule_name}: loops are right within {rule.loop_distance:g} m and "
            f"{rule.loop_angle:.3g} deg"
        )
    else:
        by_car = ViewJudge(poses, scenes.seconds, rule="car").revisit
        print(explain_no_revisit(rule, int(by_car.sum())))


def without_sensor(scenes: "SceneSet", rule: str) -> list[list[str]]:
    """Return the rows of the baselines without a sensor: accuracy alone says little."""
    from fusionslam.evaluation import ViewJudge, baselines

    judge = ViewJudge(scenes.true_poses(), scenes.seconds, rule=rule)
    ids = baselines(len(scenes))
    return [[name, *figures(judge.judge(given))] for name, given in ids.items()]
