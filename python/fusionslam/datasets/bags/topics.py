# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Assigns the topics of a bag to sensors: as the user names them, else guessed by type."""

import logging
from collections.abc import Iterable, Mapping
from difflib import get_close_matches

from fusionslam.datasets.bags.reader import Topic
from fusionslam.errors import ConfigError, DataError

logger = logging.getLogger(__name__)

_IMAGES = ("sensor_msgs/Image", "sensor_msgs/CompressedImage")
ROLES = {
    "points": ("sensor_msgs/PointCloud2",),
    "left": _IMAGES,
    "camera_info": ("sensor_msgs/CameraInfo",),
    "right": _IMAGES,
    "right_camera_info": ("sensor_msgs/CameraInfo",),
    "odometry": ("nav_msgs/Odometry",),
    "truth": ("nav_msgs/Odometry",),
    "imu": ("sensor_msgs/Imu",),
    "fix": ("sensor_msgs/NavSatFix",),
}
"""Roles that a topic can have in a dataset, with the message types of each."""
READ_LATE = ("imu", "fix")
"""Roles whose messages are read when they are needed: no frame is made of them alone."""
INFO_ROLES = {"left": "camera_info", "right": "right_camera_info"}
"""Role of the calibration of each camera of a stereo pair."""
_OF_INFO = "_camera_info"
_OF_POINTS = "_points"
TRANSFORM_TYPES = ("tf2_msgs/TFMessage", "tf/tfMessage")

# Parts of names that exclude a role.
_NOT_LEFT = ("depth", "right")
_TRUTH = ("truth", "_gt", "/gt")
_NO_RATES = ("accel", "magn")


def choose_topics(
    topics: Mapping[str, Topic], named: Mapping[str, str] | None = None, bag: str = "the bag"
) -> dict[str, str]:
    """Choose the topic of each role.

    Among topics of the right type the one with the most messages is chosen, on ties the first by
    name. Image topics without a CameraInfo beside them, or with "depth" or "right" in their name,
    come last. The CameraInfo chosen is the one whose name shares most parts with that of the
    images, and not a right camera's unless the images are. Right images have the name of the left
    ones with "right" for "left", or else "right" in their name and the same first part as the left
    ones; their CameraInfo is named likewise, or shares more parts with the right images than with
    the left ones. Odometry with "truth" or "gt" in its name is ground truth, other odometry is not.

    Any other role that is named with images is a further camera. Its CameraInfo, if not named as
    NAME_camera_info, is the free one whose name shares most parts with that of its images. A role
    NAME_points is a further scanner's.

    Args:
        topics: of the bag, by name.
        named: topics by role that are not to be guessed; an empty name leaves the role unfilled.
        bag: name of the bag in errors.

    Raises:
        ConfigError: an unknown role.
        DataError: a named topic does not exist, has another type, or is both left and right.
    """
    chosen = dict(named or {})
    for role, name in chosen.items():
        _check(topics, role, name, bag, chosen)
    for role in ROLES:
        if role not in chosen and (fitting := candidates(topics, role, chosen)):
            chosen[role] = fitting[0]
            if len(fitting) > 1:
                several = "; to merge others into it, name each with --topic NAME_points=..."
                logger.warning(
                    "%s: %s is %s, chosen of %s; name one with --topic %s=...%s",
                    bag,
                    role,
                    fitting[0],
                    ", ".join(fitting),
                    role,
                    several if role == "points" else "",
                )
    for camera in further_cameras(chosen):
        if info_role(camera) in chosen:
            continue
        taken, images = {*chosen.values()}, chosen[camera]
        free = [name for name in _of_type(topics, "camera_info") if name not in taken]
        best = max(free, key=lambda name: _shared_parts(name, images), default="")
        if best and _shared_parts(best, images):
            chosen[info_role(camera)] = best
    roles = dict.fromkeys([*ROLES, *chosen])
    used = {role: chosen[role] for role in roles if chosen.get(role)}
    if "right" in used and used["right"] == used.get("left"):
        message = f"{bag}: {used['right']} is left and right: expected two topics of a pair"
        raise DataError(message, code="no-pair", fields=(used["right"],))
    return used


def info_role(camera: str) -> str:
    """Role of a camera's calibration."""
    return INFO_ROLES.get(camera, camera + _OF_INFO)


def further_cameras(roles: Mapping[str, str]) -> tuple[str, ...]:
    """The cameras among roles in use beside "left" and "right"."""
    return tuple(
        role for role in roles if role not in ROLES and not role.endswith((_OF_INFO, _OF_POINTS))
    )


def further_scanners(roles: Mapping[str, str]) -> tuple[str, ...]:
    """The scanners among roles in use beside "points"."""
    return tuple(role for role in roles if role.endswith(_OF_POINTS))


def can_be_further(role: str) -> bool:
    """Whether a role that is not known can be a further sensor's; a near miss is a mistake."""
    if role.endswith(_OF_POINTS):
        return role.removesuffix(_OF_POINTS).isidentifier()
    name = role.removesuffix(_OF_INFO)
    return name.isidentifier() and not get_close_matches(name, ROLES, cutoff=0.8)


def _types(role: str) -> tuple[str, ...]:
    if role.endswith(_OF_POINTS):
        return ROLES["points"]
    return ROLES.get(role) or ROLES["camera_info" if role.endswith(_OF_INFO) else "left"]


def _check(
    topics: Mapping[str, Topic], role: str, name: str, bag: str, named: Mapping[str, str]
) -> None:
    is_known = role in ROLES
    if not is_known and role.endswith(_OF_INFO):
        is_known = role.removesuffix(_OF_INFO) in named
    elif role.endswith(_OF_POINTS):
        is_known = can_be_further(role)
    elif not is_known:  # a further camera's; a near miss is taken for an error
        is_known = can_be_further(role) and name in topics and topics[name].type in _IMAGES
    if not is_known:
        raise ConfigError(
            f"topics has '{role}', expected some of {', '.join(ROLES)}, a further camera's name "
            "with a topic of images, or a further scanner's, NAME_points"
        )
    if not name:
        return
    fitting = ", ".join(_of_type(topics, role)) or "none has that type"
    if name not in topics:
        message = f"{bag} has no topic {name} for {role}; that could be: {fitting}"
        raise DataError(message, code="no-topic", fields=(name, role))
    if topics[name].type not in _types(role):
        raise DataError(
            f"{bag}: {name} is of type {topics[name].type}, expected {' or '.join(_types(role))} "
            f"for {role}; that could be: {fitting}",
            code="topic-type",
            fields=(name, role),
        )


def _of_type(topics: Mapping[str, Topic], role: str) -> list[str]:
    types = _types(role)
    return [name for name, topic in topics.items() if topic.count and topic.type in types]


def candidates(topics: Mapping[str, Topic], role: str, chosen: Mapping[str, str]) -> list[str]:
    """List the topics that can have a role, best first, given the roles chosen already."""
    taken = {name for other, name in chosen.items() if other not in ROLES}
    fitting = [name for name in _of_type(topics, role) if name not in taken]
    names = sorted(fitting, key=lambda name: (-topics[name].count, name))
    if role == "left":
        infos = _of_type(topics, "camera_info")
        free = [name for name in names if name != chosen.get("right")]
        names = [name for name in free if not any(_is_twin(name, other) for other in free)]
        lacks = {name: not any(_shared_parts(name, info) for info in infos) for name in names}
        return sorted(names, key=lambda name: (_has(name, _NOT_LEFT), lacks[name]))
    if role == "camera_info":
        camera = chosen.get("left", "")
        own = [
            name
            for name in names
            if name != chosen.get("right_camera_info")
            and (_is_right(camera) or not _is_right(name))
        ]
        return sorted(own, key=lambda name: -_shared_parts(name, camera))
    if role == "right":
        return _right_images(names, chosen.get("left", ""))
    if role == "right_camera_info":
        return _right_infos(names, chosen)
    if role == "imu":
        return sorted(names, key=lambda name: _has(name, _NO_RATES))
    if role in ("odometry", "truth"):
        return [name for name in names if _has(name, _TRUTH) == (role == "truth")]
    return names


def _right_images(names: Iterable[str], left: str) -> list[str]:
    """List the image topics that can be the right camera of a left one, best first."""
    fitting = [
        name
        for name in names
        if left
        and name != left
        and _is_right(name)
        and not _has(name, ("depth",))
        and (_is_twin(name, left) or _shared_parts(name, left))
    ]
    return sorted(fitting, key=lambda name: (not _is_twin(name, left), -_shared_parts(name, left)))


def _right_infos(names: Iterable[str], chosen: Mapping[str, str]) -> list[str]:
    """List the CameraInfo topics that match the right images better than the left ones."""
    right, left, taken = (chosen.get(role, "") for role in ("right", "left", "camera_info"))
    fitting = [
        name
        for name in names
        if right
        and name != taken
        and (_is_twin(name, taken) or _shared_parts(name, right) > _shared_parts(name, left))
    ]
    return sorted(
        fitting, key=lambda name: (not _is_twin(name, taken), -_shared_parts(name, right))
    )


def _is_right(name: str) -> bool:
    return _has(name, ("right",))


def _is_twin(right: str, left: str) -> bool:
    """Whether the names differ only in "left" and "right"."""
    return _is_right(right) and right.lower().replace("right", "left") == left.lower()


def _has(name: str, parts: Iterable[str]) -> bool:
    return any(part in name.lower() for part in parts)


def _shared_parts(first: str, second: str) -> int:
    """Number of leading parts that two names have in common."""
    pairs = list(zip(first.strip("/").split("/"), second.strip("/").split("/"), strict=False))
    return next((k for k, (a, b) in enumerate(pairs) if a != b), len(pairs))
