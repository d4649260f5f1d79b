# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Find what a robot lacks for the nodes, with advice."""

from collections.abc import Iterator
from math import isnan
from statistics import median_low

import numpy as np

from fusionslam.base.texts import counted
from fusionslam.datasets.bags.indexed_bag import Series
from fusionslam.datasets.bags.messages import is_static
from fusionslam.datasets.bags.pairing import NO_PAIRS
from fusionslam.datasets.bags.topics import ROLES, TRANSFORM_TYPES
from fusionslam.doctor import Finding
from fusionslam.errors import DataError, cause_of, one_line
from fusionslam.ros.check.evidence import Evidence
from fusionslam.ros.check.graph import CLOCK
from fusionslam.ros.topic_choice import needed_roles
from fusionslam.sensors.messages import NANOSECONDS, Imu, Odometry, Picture, Scan

_WORDS = {
    "points": "scans",
    "left": "images",
    "camera_info": "CameraInfo",
    "right": "right images",
    "right_camera_info": "right CameraInfo",
    "odometry": "odometry",
    "truth": "true poses",
    "imu": "IMU",
}
_CAMERA = "start the camera's driver"
_ADVICE = {
    "points": "start the scanner's driver",
    "left": _CAMERA,
    "right": _CAMERA,
    "odometry": "ratslam and mapper need it, clouds are fused as if the robot stood still; "
    "data_fusion and mapper can take it from scans (odometry lidar, or inertial with an IMU)",
    "truth": "only lv_analyzer and lv_dataset_creator need them",
    "imu": "it tells the turn within scans where odometry is slow or fails",
}
_SET_CLOCKS = "set the clocks (chrony, PTP)"
_NO_POINTS = {
    "lidar": "; does the scanner look where the camera looks, and is the frame of the CameraInfo "
    "the optical one (z ahead, x right)?",
    "stereo": "; do the two cameras see the same, with enough light and texture?",
    "cloud": "",
}
_LATE = (
    "transforms, CameraInfo or odometry come too late or do not reach back to the scans; "
    "data_fusion can wait longer ({})"
)
_APART_S = 1.0
# Stamps further than this from ROS time come from another clock; they are not just late.
_FAR_S = 10.0
_QUALITIES = {None: "", True: ", reliable", False: ", best effort"}
_FELT = (5.0, 20.0)
"""m/s^2: accelerations that an IMU of a robot feels, in the units of ROS."""
_TF_IMU = "TF IMU"
_LARGE = ("points", "left", "right")
"""Roles with messages of many packets."""


def list_findings(evidence: Evidence) -> Iterator[Finding]:
    """Yield what a live robot can lack, beyond its overview."""
    needed = needed_roles(evidence.config.fusion.source)
    yield from _check_clock(evidence)
    for role in evidence.choices:
        yield _check_topic(evidence, role, role in needed)
        yield from _check_publishers(evidence, role, role in needed)
        if role in evidence.source.roles:
            yield from _check_stamps(evidence, role)
            yield from _check_content(evidence, role)
        elif role in evidence.roles:
            yield _report_silence(evidence, role, role in needed)
    yield from _check_delay(evidence)
    yield from _check_links(evidence)
    yield _check_fusing(evidence)


def _check_clock(evidence: Evidence) -> Iterator[Finding]:
    graph, advice = evidence.graph, evidence.advice
    time = "sim time" if graph.sim_time else "wall time"
    state = f"{graph.where}, {counted(len(graph.topics), 'topic')}, {time}"
    if graph.topics or not advice.no_topics:
        yield Finding(advice.graph, state)
    else:
        yield Finding(advice.graph, f"{state}: {advice.no_topics}", "no-topics")
    if graph.sim_time and not evidence.clock:
        fault = "stands at 0" if CLOCK in graph.topics else "is missing"
        detail = f"use_sim_time is set, but {CLOCK} {fault}: {advice.no_clock}"
        yield Finding("clock", detail, "no-clock", [CLOCK] if CLOCK in graph.topics else [])
    roles, indexed = evidence.source.roles, evidence.source.indexed
    delays = {topic: _delay_s(indexed[topic]) for topic in roles.values()}
    delays = {topic: delay for topic, delay in delays.items() if not isnan(delay)}
    if not delays:
        return
    usual = median_low(delays.values())
    others = {t: delay - usual for t, delay in delays.items() if abs(delay - usual) > _APART_S}
    if others:
        behind = max(others.values(), key=abs)
        detail = (
            f"stamps of {', '.join(others)} lie {abs(behind):.1f} s "
            f"{'before' if behind > 0 else 'after'} those that arrive with them: {_SET_CLOCKS}"
        )
        yield Finding("clock", detail, "other-clock", tuple(others), optional=True)
    elif abs(usual) >= _FAR_S and not graph.sim_time:
        detail = (
            f"stamps lie {abs(usual):.0f} s {'before' if usual > 0 else 'after'} the time of this "
            f"machine, as in a bag: fine for the nodes; {advice.show_bag}"
        )
        yield Finding("clock", detail)


def _delay_s(series: Series) -> float:
    """Median delay from stamp to arrival in seconds; NaN without stamps."""
    delays = series.delays_ns[np.array(series.headers, dtype=np.int64) > 0]
    return float(np.median(delays)) / NANOSECONDS if len(delays) else float("nan")


def _check_topic(evidence: Evidence, role: str, needed: bool) -> Finding:
    """Check that the topic that the nodes listen to exists; if not, say what to do."""
    choice, what = evidence.choices[role], _WORDS[role]
    nodes = evidence.graph.publishers.get(choice.topic, ())
    if choice.topic and not choice.is_guess:
        if len(nodes) < 2:
            quality = _QUALITIES[evidence.graph.reliable.get(choice.topic)]
            return Finding(what, f"{choice.topic} of {', '.join(nodes)}{quality}")
        detail = (
            f"{choice.topic} has {len(nodes)} publishers, {', '.join(nodes)}: "
            f"{evidence.advice.several}; stop the others, or remap them"
        )
        return Finding(what, detail, "many-publishers", tuple(nodes), optional=True)
    other = evidence.graph.topics.get(choice.asked)
    code = "wrong-type" if other else "not-published"
    detail = f"{choice.asked} is {f'a {other.type}' if other else 'not published'}"
    if not choice.topic:
        calibrate = evidence.advice.calibrate
        types = " or ".join(name.partition("/")[2] for name in ROLES[role])
        detail += f", and no other {types} would fit: {_ADVICE.get(role, calibrate)}"
        return Finding(what, detail, code, optional=not needed)
    more = f" (would fit, too: {', '.join(choice.others)})" if choice.others else ""
    detail += f"; give the nodes {evidence.advice.remapping(choice.remapping)}{more}"
    return Finding(what, detail, code, (choice.remapping, *choice.others), optional=not needed)


def _check_publishers(evidence: Evidence, role: str, needed: bool) -> Iterator[Finding]:
    """Report publishers that may lose messages, or whose messages may be misread."""
    topic, graph = evidence.choices[role].topic, evidence.graph
    if role in _LARGE and not graph.reliable.get(topic, True):
        detail = (
            f"{topic} is best effort, so nodes subscribe as such: messages that lose a packet are "
            "lost; if the rate is too low, raise net.core.rmem_max, or make the driver reliable"
        )
        yield Finding(f"{_WORDS[role]} QoS", detail, "best-effort", (topic,), optional=True)
    if foreign := graph.foreign.get(topic):
        detail = (
            f"{', '.join(foreign)} publishes it with another type or definition than the "
            f"{graph.topics[topic].type} of this machine (ros2 topic info -v {topic}): use the "
            "same ROS distribution and the same version of its package"
        )
        yield Finding(
            f"{_WORDS[role]} type", detail, "other-definition", (*foreign,), optional=not needed
        )


def _report_silence(evidence: Evidence, role: str, needed: bool) -> Finding:
    topic, code, fields = evidence.roles[role], "silent", tuple[str, ...]()
    why = evidence.advice.silent
    for node in evidence.graph.publishers.get(topic, ()):
        if address := evidence.unreachable.get(node):
            code, fields = "unreachable", (node, address)
            why = (
                f"{node} gives its address as {address}, where nothing answers: "
                f"{evidence.advice.unreachable}"
            )
    detail = f"nothing arrived on {topic} in {evidence.seconds:g} s: {why}"
    return Finding(f"{_WORDS[role]} rate", detail, code, fields, optional=not needed)


def _check_stamps(evidence: Evidence, role: str) -> Iterator[Finding]:
    """Report stamps that the nodes cannot use; the overview has the rates."""
    stamps = evidence.source.series(role).stamps_ns
    repeated = len(stamps) > 1 and bool(np.median(np.diff(stamps)) <= 0)
    missing = 0 if evidence.by_arrival else int((stamps == 0).sum())
    if missing or repeated:
        what = f"{missing} of {len(stamps)} stamps are zero" if missing else "stamps do not rise"
        detail = (
            f"{what}: the driver has to stamp each message; until it does, start the nodes "
            f"with {_by_arrival(evidence)}"
        )
        code = "zero-stamps" if missing else "constant-stamps"
        yield Finding(f"{_WORDS[role]} rate", detail, code, (str(missing),))


def _by_arrival(evidence: Evidence) -> str:
    return evidence.advice.parameter("node/stamps", "arrival")


def _check_content(evidence: Evidence, role: str) -> Iterator[Finding]:
    """Report content that the overview and the fusing do not judge."""
    value, what = evidence.first(role), f"{_WORDS[role]} content"
    if isinstance(value, Scan | Odometry | Imu) and not value.frame_id:
        detail = "their frame has no name; the driver has to give it one"
        yield Finding(what, detail, "no-frame-name", optional=not isinstance(value, Scan))
    if isinstance(value, Imu) and not _FELT[0] < (felt := np.linalg.norm(value.linear)) < _FELT[1]:
        detail = (
            f"it feels {felt:.3g} m/s^2, expected about 9.8 of gravity: are accelerations in "
            "m/s^2, and turn rates in rad/s?"
        )
        yield Finding(what, detail, "imu-unit", (f"{felt:.3g}",), optional=True)
    if isinstance(value, Picture) and value.image.ndim == 2:
        yield Finding(what, "grey, so clouds are, too", "grey-images", optional=True)
    online = evidence.config.online
    if role == "odometry" and isinstance(value, Odometry):
        frame = value.frame_id
        if frame and frame == online.truth_frame != online.odometry_frame:
            remedy = evidence.advice.parameter("online/odometry_frame", frame)
            detail = f"in '{frame}', which data_fusion takes for true poses: {remedy}"
            yield Finding(what, detail, "taken-for-truth", (remedy,), optional=True)


def _check_delay(evidence: Evidence) -> Iterator[Finding]:
    """Report moving transforms that come later than data_fusion waits."""
    for topic, series in evidence.source.indexed.items():
        is_moving = evidence.bag.topics[topic].type in TRANSFORM_TYPES and not is_static(topic)
        delay = _delay_s(series)
        if is_moving and evidence.config.online.wait < delay < _FAR_S:
            wait = evidence.advice.parameter("online/wait", f"{2 * delay:.1f}")
            detail = f"{topic} arrives {delay:.1f} s late: start data_fusion with {wait}"
            yield Finding("TF delay", detail, "late-transforms", (wait,), optional=True)


def _check_links(evidence: Evidence) -> Iterator[Finding]:
    """Report frames that TF does not link, with advice on what to publish."""
    roles, tree = evidence.source.roles, evidence.source.frames.tree
    scanner = evidence.source.series("points").frame_id if "points" in roles else ""
    camera = evidence.source.optical_frame() if "left" in roles else ""
    links = [("TF camera", camera, scanner)] if camera and scanner else []
    if scanner and "imu" in roles and (imu := evidence.source.series("imu").frame_id):
        links.append((_TF_IMU, imu, scanner))
    if evidence.config.fusion.frame in ("robot", "odometry") and (scanner or camera):
        if robot := evidence.robot:
            links.append(("TF robot", robot, scanner or camera))
        else:
            detail = (
                f"the robot's frame is not known: TF has {', '.join(tree.frames) or 'no frames'}, "
                "no base_footprint or base_link, and there is no odometry; name it with "
                f"{evidence.advice.parameter('online/robot_frame', 'NAME')}"
            )
            yield Finding("TF robot", detail, "no-robot-frame")
    advice = "" if "/tf_static" in evidence.bag.topics else evidence.advice.bag_transforms
    for what, target, source in links:
        if target == source:
            continue
        try:
            yield Finding(what, " <- ".join(tree.chain(target, source)))
        except DataError as error:
            is_parent = target in tree.frames or what == "TF robot"
            parent, child = (target, source) if is_parent else (source, target)
            top = tree.root(child)
            publish = evidence.advice.publish.format(parent=parent, child=top)
            detail = f"{one_line(error)}: {advice}{publish}"
            yield Finding(what, detail, error.code, (parent, top), optional=what == _TF_IMU)


def _check_fusing(evidence: Evidence) -> Finding:
    trial, config, overview = evidence.trial, evidence.config.fusion, evidence.overview
    if evidence.has_clouds and trial is not None:
        ground = "" if config.ground == "none" else f", {trial.above} of them above the ground"
        code = "" if trial.above else "only-ground"
        return Finding("fusing", f"{trial}{ground}", code, optional=True)
    code, cause = "no-cloud", tuple[str, ...]()
    if trial is not None:
        hint = _NO_POINTS[config.source] if trial.status == "doubtful" else ""
        problem = f"{trial.problem}{hint}"
    elif overview.error is not None:
        code, cause = "no-frame", cause_of(overview.error)
        problem = one_line(overview.error)
        if cause[0] == NO_PAIRS:
            problem += f": {_SET_CLOCKS}, or start the nodes with {_by_arrival(evidence)}"
    elif overview.fusion is not None and overview.fusion.problem:
        code, problem = "no-frame", overview.fusion.problem
    else:
        wait = evidence.advice.parameter("online/wait", 2 * evidence.config.online.wait)
        code, problem = "late-messages", _LATE.format(wait)
    problem = problem.removeprefix(f"{evidence.bag.path}: ")
    return Finding("fusing", f"not possible: {problem}", code, cause)
