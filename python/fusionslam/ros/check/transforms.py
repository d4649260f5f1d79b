# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Check that TF places a robot's sensors, and that clouds can be fused."""

from collections.abc import Collection, Iterator, Sequence, Set

import numpy as np

from fusionslam.doctor import Finding
from fusionslam.errors import DataError, one_line
from fusionslam.pipelines.bag_overview import rate_words, step_words
from fusionslam.ros.check.observed_topics import delay_s
from fusionslam.ros.check.topics import FAR_S
from fusionslam.ros.check.trial_fusion import TrialFusion

_PUBLISH = (
    "start robot_state_publisher with the robot's URDF, or rosrun tf2_ros "
    "static_transform_publisher X Y Z YAW PITCH ROLL {parent} {child}"
)
_AT_START = (
    "a bag sends /tf_static once, at its start: start this first, then rosbag play; on a robot, "
)


def frame_findings(trial: TrialFusion, scanner: str, camera: str) -> Iterator[Finding]:
    """Report what TF knows about the frames in use.

    Args:
        trial: has received all transforms.
        scanner: frame of the scans; empty if not needed or unknown.
        camera: optical frame of the camera; empty if not needed or unknown.
    """
    tree, robot = trial.links.tree, trial.frames.robot.robot or ""
    for problem, count in trial.links.problems.items():
        detail = f"{problem}: {count} left out; rostopic info /tf names the publishers"
        yield Finding("TF", False, detail, optional=True)
    ways = [("TF camera", camera, scanner)] if scanner and camera else []
    if trial.config.fusion.frame in ("robot", "odometry") and (scanner or camera):
        if robot:
            ways.append(("TF robot", robot, scanner or camera))
        else:
            yield _no_robot_finding(tree.frames)
    used, advise = {robot}, True
    for what, target, source in ways:
        finding, chain = _link_finding(trial, what, target, source, advise)
        used.update(chain)
        advise &= finding.fine
        yield finding
    yield from _moving_findings(trial, used)


def _no_robot_finding(frames: Collection[str]) -> Finding:
    detail = (
        f"the robot's frame is not known: TF has {', '.join(frames) or 'no frames'}, no "
        "base_footprint or base_link, and there is no odometry; name it with "
        "_online/robot_frame:=NAME"
    )
    return Finding("TF robot", False, detail)


def _link_finding(
    trial: TrialFusion, what: str, target: str, source: str, advise: bool
) -> tuple[Finding, Sequence[str]]:
    """Check that TF links two frames, with advice if not; also return the frames on the way."""
    tree, ends = trial.links.tree, (target.removeprefix("/"), source.removeprefix("/"))
    if ends[0] == ends[1]:
        return Finding(what, True, f"both are '{target}'"), ()
    try:
        chain = tree.chain(target, source)
    except DataError as error:
        parent, child = ends if ends[0] in tree.frames or what == "TF robot" else ends[::-1]
        has_static = len(tree.frames) > len(trial.links.moving) + 1
        publish = _PUBLISH.format(parent=parent, child=tree.root(child))
        advice = f": {'' if has_static else _AT_START}{publish}" if advise else ""
        return Finding(what, False, one_line(error) + advice), ()
    return Finding(what, True, " <- ".join(chain)), chain


def _moving_findings(trial: TrialFusion, used: Set[str]) -> Iterator[Finding]:
    """Report how late the moving transforms in use arrive."""
    wait = trial.config.online.wait
    for child in sorted(used & trial.links.moving.keys()):
        series = trial.links.moving[child]
        delay = delay_s(series)
        words = rate_words(series) if abs(delay) < FAR_S else step_words(series.stamps_ns)
        late = wait < delay < FAR_S
        advice = f": that is late; start data_fusion with _online/wait:={2 * delay:.1f}"
        fine = not late and bool((np.diff(series.stamps_ns) >= 0).all())
        yield Finding("TF rate", fine, f"'{child}' {words}{advice * late}", optional=True)


def cloud_finding(trial: TrialFusion, lacking: str) -> Finding:
    """Report whether a cloud could be fused from the messages.

    Args:
        trial: has received all messages.
        lacking: the data that did not arrive at all, for people; empty if all did.
    """
    if trial.first is None:
        reason = trial.reason() or "no scan found its image, listen longer (--seconds)"
        return Finding("fusing", False, f"not possible: {lacking or reason}")
    words = str(trial.first)
    if trial.config.fusion.ground != "none":
        words += f", {trial.above} of them are above the ground"
    return Finding("fusing", bool(trial.above), words, optional=True)
