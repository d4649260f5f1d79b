# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Which topic of a bag is which sensor: named by the user, else guessed by type."""

import logging
from collections.abc import Iterable, Mapping

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
}
"""What a topic can be to a dataset, and the types that it can then have."""
INFO_ROLES = {"left": "camera_info", "right": "right_camera_info"}
"""Which role has the calibration of a camera."""
TRANSFORM_TYPES = ("tf2_msgs/TFMessage", "tf/tfMessage")

# Parts of names that tell what a topic is not.
_NOT_LEFT = ("depth", "right")
_TRUTH = ("truth", "_gt", "/gt")


def choose_topics(
    topics: Mapping[str, Topic], named: Mapping[str, str] | None = None, bag: str = "the bag"
) -> dict[str, str]:
    """The topic of each role that can be filled.

    Of several that have the type, the one with the most messages is taken, and of those the first
    by name. Images of a camera without CameraInfo beside them, and such as have "depth" or "right"
    in their name, come last. The CameraInfo is the one whose name shares most parts with that of
    the images, none of a right camera. The right images are named as the left ones but for "right"
    in place of "left", or else have "right" in their name and the first part of it in common with
    the left ones; their CameraInfo is named likewise, or shares more parts with the right images
    than with the left ones. Odometry with "truth" or "gt" in its name is the truth, other odometry
    is not.

    Args:
        topics: of the bag, by name.
        named: topics by role, which are not guessed; an empty name leaves the role unfilled.
        bag: what errors call the bag.

    Raises:
        ConfigError: an unknown role.
        DataError: no topic of that name, or of another type, or one for both sides of a pair.
    """
    chosen = dict(named or {})
    for role, name in chosen.items():
        _check(topics, role, name, bag)
    for role in ROLES:
        if role not in chosen and (fitting := candidates(topics, role, chosen)):
            chosen[role] = fitting[0]
            if len(fitting) > 1:
                logger.warning(
                    "%s: %s is %s, chosen of %s; name one with --topic %s=...",
                    bag,
                    role,
                    fitting[0],
                    ", ".join(fitting),
                    role,
                )
    used = {role: chosen[role] for role in ROLES if chosen.get(role)}
    if "right" in used and used["right"] == used.get("left"):
        raise DataError(f"{bag}: {used['right']} is left and right: expected two topics of a pair")
    return used


def _check(topics: Mapping[str, Topic], role: str, name: str, bag: str) -> None:
    if role not in ROLES:
        raise ConfigError(f"topics has '{role}', expected some of {', '.join(ROLES)}")
    if not name:
        return
    fitting = ", ".join(_of_type(topics, role)) or "none has that type"
    if name not in topics:
        raise DataError(f"{bag} has no topic {name} for {role}; that could be: {fitting}")
    if topics[name].type not in ROLES[role]:
        raise DataError(
            f"{bag}: {name} is of type {topics[name].type}, expected {' or '.join(ROLES[role])} "
            f"for {role}; that could be: {fitting}"
        )


def _of_type(topics: Mapping[str, Topic], role: str) -> list[str]:
    return [name for name, topic in topics.items() if topic.count and topic.type in ROLES[role]]


def candidates(topics: Mapping[str, Topic], role: str, chosen: Mapping[str, str]) -> list[str]:
    """The topics that can have a role, best first, where those of ``chosen`` have theirs."""
    names = sorted(_of_type(topics, role), key=lambda name: (-topics[name].count, name))
    if role == "left":
        infos = _of_type(topics, "camera_info")
        free = [name for name in names if name != chosen.get("right")]
        names = [name for name in free if not any(_is_twin(name, other) for other in free)]
        return sorted(names, key=lambda name: (_has(name, _NOT_LEFT), not _near(name, infos)))
    if role == "camera_info":
        camera = chosen.get("left", "")
        own = [
            name
            for name in names
            if name != chosen.get("right_camera_info")
            and (_is_right(camera) or not _is_right(name))
        ]
        return sorted(own, key=lambda name: -_shared(name, camera))
    if role == "right":
        return _right_images(names, chosen.get("left", ""))
    if role == "right_camera_info":
        return _right_infos(names, chosen)
    if role in ("odometry", "truth"):
        return [name for name in names if _has(name, _TRUTH) == (role == "truth")]
    return names


def _right_images(names: Iterable[str], left: str) -> list[str]:
    """The image topics that can be the right ones beside the left ones, best first."""
    fitting = [
        name
        for name in names
        if left
        and name != left
        and _is_right(name)
        and not _has(name, ("depth",))
        and (_is_twin(name, left) or _shared(name, left))
    ]
    return sorted(fitting, key=lambda name: (not _is_twin(name, left), -_shared(name, left)))


def _right_infos(names: Iterable[str], chosen: Mapping[str, str]) -> list[str]:
    """The CameraInfo topics that belong to the right images rather than to the left ones."""
    right, left, taken = (chosen.get(role, "") for role in ("right", "left", "camera_info"))
    fitting = [
        name
        for name in names
        if right
        and name != taken
        and (_is_twin(name, taken) or _shared(name, right) > _shared(name, left))
    ]
    return sorted(fitting, key=lambda name: (not _is_twin(name, taken), -_shared(name, right)))


def _is_right(name: str) -> bool:
    return _has(name, ("right",))


def _is_twin(right: str, left: str) -> bool:
    """Whether the names differ in the side alone."""
    return _is_right(right) and right.lower().replace("right", "left") == left.lower()


def _has(name: str, parts: Iterable[str]) -> bool:
    return any(part in name.lower() for part in parts)


def _near(name: str, infos: Iterable[str]) -> bool:
    return any(_shared(name, info) for info in infos)


def _shared(first: str, second: str) -> int:
    """How many parts two names have in common before they part."""
    pairs = list(zip(first.strip("/").split("/"), second.strip("/").split("/"), strict=False))
    return next((k for k, (a, b) in enumerate(pairs) if a != b), len(pairs))
