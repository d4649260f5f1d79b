# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Check that the topics of a robot's sensors and odometry are what the nodes need."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from fusionslam.datasets.bags.reader import Topic
from fusionslam.datasets.bags.topics import INFO_ROLES, ROLES
from fusionslam.doctor import Finding
from fusionslam.errors import DataError, one_line
from fusionslam.pipelines.bag_overview import rate_words, step_words
from fusionslam.pipelines.overview import calibration_words
from fusionslam.ros.check.observed_topics import Choice, ObservedTopic
from fusionslam.sensors.camera_info import camera_from, check_pair, rectified
from fusionslam.sensors.frame_builder import OnlineConfig
from fusionslam.sensors.messages import NANOSECONDS, CameraInfo, Odometry, Picture, Scan

WORDS = {
    "points": "scans",
    "left": "images",
    "camera_info": "CameraInfo",
    "right": "right images",
    "right_camera_info": "right CameraInfo",
    "odometry": "odometry",
    "truth": "true poses",
}
"""The name of each role, for people."""
_CAMERA = "start the camera's driver"
_CALIBRATE = "calibrate the camera (rosrun camera_calibration), its driver then publishes it"
_ADVICE = {
    "points": "start the scanner's driver",
    "left": _CAMERA,
    "camera_info": _CALIBRATE,
    "right": _CAMERA,
    "right_camera_info": _CALIBRATE,
    "odometry": "ratslam needs it; clouds are fused as if the robot stood still",
    "truth": "only lv_analyzer and lv_dataset_creator need them",
}
_APART_S = 1.0
FAR_S = 10.0
"""Stamps further than this from ROS time come from another clock; they are not just late."""


def topic_finding(
    choice: Choice,
    topics: Mapping[str, Topic],
    publishers: Mapping[str, Sequence[str]],
    needed: bool,
) -> Finding:
    """Check that the topic that the nodes listen to exists; if not, say what to do."""
    what, nodes = WORDS[choice.role], publishers.get(choice.topic, ())
    if choice.topic and not choice.is_guess:
        if len(nodes) < 2:
            return Finding(what, True, f"{choice.topic} of {', '.join(nodes)}")
        detail = (
            f"{choice.topic} has {len(nodes)} publishers, {', '.join(nodes)}: nodes hear one of "
            "them alone; stop the others, or remap them"
        )
        return Finding(what, False, detail, optional=True)
    types = " or ".join(name.partition("/")[2] for name in ROLES[choice.role])
    other = topics.get(choice.asked)
    lacking = f"{choice.asked} is {'a ' + other.type if other else 'not published'}"
    if not choice.topic:
        detail = f"{lacking}, and no other {types} would fit: {_ADVICE[choice.role]}"
        return Finding(what, False, detail, optional=not needed)
    more = f" (would fit, too: {', '.join(choice.others)})" if choice.others else ""
    detail = f"{lacking}; give the nodes {choice.remapping}{more}"
    return Finding(what, False, detail, optional=not needed)


def silence_finding(
    choice: Choice, seconds: float, unreachable: Mapping[str, str], needed: bool
) -> Finding:
    """Report that a published topic delivered nothing, with possible reasons."""
    why = "is the sensor connected, is a bag paused or over?"
    if unreachable:
        node, address = next(iter(unreachable.items()))
        why = (
            f"{node} says that it is at {address}, where nothing answers: set ROS_IP where it runs "
            "to an address that is known here; if it crashed, rosnode cleanup"
        )
    detail = f"nothing arrived on {choice.topic} in {seconds:g} s: {why}"
    return Finding(f"{WORDS[choice.role]} rate", False, detail, optional=not needed)


def rate_finding(role: str, heard: ObservedTopic, by_arrival: bool, jump_s: float) -> Finding:
    """Report how often messages come, how late, and whether their stamps can be used.

    Args:
        role: of the topic.
        heard: the topic, with at least one message.
        by_arrival: whether the nodes use arrival times instead of stamps.
        jump_s: a step back by this much means that the clock went back.
    """
    what, stamps = f"{WORDS[role]} rate", heard.series.stamps_ns
    if by_arrival:
        stamps = np.array(heard.series.times, dtype=np.int64)
    elif heard.unstamped:
        detail = (
            f"{heard.unstamped} of {heard.count} stamps are zero: the driver has to stamp its "
            "messages; until it does, start the nodes with _node/stamps:=arrival"
        )
        return Finding(what, False, detail)
    if len(stamps) < 2:
        # A calibration may be published only once.
        return Finding(what, role in INFO_ROLES.values(), "one message", optional=True)
    rises = np.diff(stamps)
    words = step_words(stamps)
    if np.median(rises) <= 0:
        return Finding(what, False, f"{words}: the driver has to stamp each message anew")
    if not by_arrival and abs(heard.delay_s) < FAR_S:
        words = rate_words(heard.series)
    if rises.min() <= -jump_s * NANOSECONDS:
        words += "; when the clock goes back, as when a bag begins anew, the nodes drop what waits"
    return Finding(what, bool((rises >= 0).all()), words, optional=True)


def unreadable_finding(role: str, heard: ObservedTopic) -> Finding:
    """Report that some messages cannot be used."""
    detail = f"{heard.unreadable} cannot be read, the last one: {heard.why}"
    return Finding(f"{WORDS[role]} content", False, detail, optional=heard.value is not None)


def scan_finding(scan: Scan) -> Finding:
    """Describe a scan."""
    valid = np.isfinite(scan.points).all(axis=1)
    count = len(scan.points)
    if not valid.any():
        reason = "all its points are NaN" if count else "it is empty"
        return Finding("scans content", False, f"nothing can be coloured in a scan: {reason}")
    ranges = np.linalg.norm(scan.points[valid], axis=1)
    names = ["x", "y", "z", *scan.fields, *(["rgb"] if scan.colors is not None else [])]
    detail = (
        f"{count} points ({', '.join(names)}), {100 * (1 - valid.mean()):.0f} % without return, "
        f"{ranges.min():.1f} to {ranges.max():.1f} m away, in '{scan.frame_id}'"
    )
    return _require_frame("scans content", detail, scan.frame_id)


def image_finding(role: str, picture: Picture, type_name: str) -> Finding:
    """Describe an image."""
    height, width = picture.image.shape[:2]
    detail = f"{width}x{height}, {type_name.partition('/')[2]}, in '{picture.frame_id}'"
    if picture.image.ndim == 2:
        detail += "; they are grey, so clouds are, too"
        return Finding(f"{WORDS[role]} content", False, detail, optional=True)
    return Finding(f"{WORDS[role]} content", True, detail)


def info_finding(role: str, info: CameraInfo, picture: Picture | None, topic: str) -> Finding:
    """Check that a calibration can be used and fits the images."""
    try:
        camera = camera_from(info, np.eye(4), topic)
        if picture is not None:
            rectified(picture, info, topic)
    except DataError as error:
        return Finding(f"{WORDS[role]} content", False, f"{one_line(error)}: {_CALIBRATE}")
    is_bent = info.distortion.any()
    lens = f"distortion {info.distortion_model}" if is_bent else "no distortion"
    detail = f"{calibration_words(camera)}, {lens}, in '{info.frame_id}'"
    frame = info.frame_id or (picture.frame_id if picture is not None else "")
    return _require_frame(f"{WORDS[role]} content", detail, frame)


def pair_finding(left: CameraInfo, right: CameraInfo, topics: Mapping[str, str]) -> Finding:
    """Check that the calibrations of two cameras are those of a stereo pair."""
    try:
        check_pair(left, right, topics)
    except DataError as error:
        return Finding("stereo", False, one_line(error))
    return Finding("stereo", True, "the two cameras are calibrated as a pair")


def odometry_finding(role: str, odometry: Odometry, config: OnlineConfig) -> Finding:
    """Report the frames that odometry, or ground truth, relates."""
    frame, child = odometry.frame_id, odometry.child_frame_id
    detail = f"'{child}' in '{frame}'"
    truth = config.truth_frame
    if role == "odometry" and truth and frame == truth != config.odometry_frame:
        detail += f", which data_fusion takes for true poses: _online/odometry_frame:={frame}"
        return Finding(f"{WORDS[role]} content", False, detail, optional=True)
    return _require_frame(f"{WORDS[role]} content", detail, frame and child, optional=True)


def sync_findings(
    scans: ObservedTopic, images: ObservedTopic, reach_s: float, by_arrival: bool, what: str
) -> Iterator[Finding]:
    """Check that scans, or left images, have an image near in time; ``what`` names the pair."""
    times = [np.array(h.series.times if by_arrival else h.series.headers) for h in (scans, images)]
    first, other = times[0], np.sort(times[1])
    if not len(first) or not len(other):
        return
    after = np.searchsorted(other, first).clip(1, max(len(other) - 1, 1))
    nearest = np.minimum(
        np.abs(first - other[after - 1]), np.abs(first - other[after.clip(max=len(other) - 1)])
    )
    near = nearest <= reach_s * NANOSECONDS
    words = (
        f"{near.sum()} of {len(near)} {what} within {reach_s:g} s; the nearest is "
        f"{np.median(nearest) / 1e6:.1f} ms away (median)"
    )
    if near.mean() > 0.5:
        yield Finding("pairs", True, words)
        return
    advice = (
        "set the clocks of scanner and camera (chrony, PTP), or start the nodes with "
        "_node/stamps:=arrival"
    )
    yield Finding("pairs", False, f"{words}: {advice}", optional=bool(near.any()))


def motion_finding(scans: ObservedTopic, odometry: ObservedTopic) -> Finding | None:
    """Report odometry whose stamps differ from those of scans arriving with it, if any."""
    gap = odometry.delay_s - scans.delay_s
    if not abs(gap) > _APART_S:
        return None
    detail = (
        f"odometry is stamped {abs(gap):.1f} s {'before' if gap > 0 else 'after'} the scans that "
        "arrive with it: set the clocks (chrony, PTP), else clouds come that much later, or as if "
        "the robot stood still"
    )
    return Finding("motion", False, detail, optional=True)


def clock_finding(heard: Mapping[str, ObservedTopic], sim_time: bool) -> Finding | None:
    """Report stamps of another clock than ROS time; None if there are none."""
    far = {h.topic: h.delay_s for h in heard.values() if abs(h.delay_s) >= FAR_S}
    if not far or sim_time:
        return None
    delay = next(iter(far.values()))
    place = f"{abs(delay):.0f} s {'before' if delay > 0 else 'after'} the time of this machine"
    if len(far) < sum(h.count > 0 for h in heard.values()):
        detail = f"stamps of {', '.join(far)} lie {place}: set the clocks (chrony, PTP)"
        return Finding("clock", False, detail, optional=True)
    detail = (
        f"stamps lie {place}, as in a bag: fine for the nodes; RViz needs rosparam set "
        "use_sim_time true before rosbag play --clock"
    )
    return Finding("clock", True, detail)


def _require_frame(what: str, detail: str, frame: str, optional: bool = False) -> Finding:
    if frame:
        return Finding(what, True, detail)
    return Finding(
        what, False, f"{detail}: the frame has no name; its driver has to give it one", optional
    )
