# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Values of the library as messages of Foxglove's well-known schemas."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fusionslam.base.arrays import Floats
from fusionslam.datasets.bags.image_messages import compressed_parts
from fusionslam.report.live.foxglove_sdk import messages as fox
from fusionslam.sensors.messages import NANOSECONDS, FrameTransforms, Picture, Scan

_UNCOLOURED = 160
_LATEST_S = 2**32 - 1
_IDENTITY = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
_NODE_M, _LINK_M = 0.12, 0.03
_NODE = fox.Color(r=0.95, g=0.75, b=0.2, a=1.0)
_LINK = fox.Color(r=0.35, g=0.65, b=0.95, a=1.0)
_LOOP = fox.Color(r=0.85, g=0.2, b=0.25, a=1.0)
_NUMBERS = fox.PackedElementFieldNumericType
_FIELDS = [
    *((name, 4 * k, _NUMBERS.Float32) for k, name in enumerate("xyz")),
    *((name, 12 + k, _NUMBERS.Uint8) for k, name in enumerate(("red", "green", "blue", "alpha"))),
]
_CLOUD = np.dtype([("points", np.float32, 3), ("colors", np.uint8, 4)])


def cloud_message(scan: Scan) -> fox.PointCloud:
    """Return points with their colours, grey without."""
    packed = np.empty(len(scan.points), _CLOUD)
    packed["points"] = scan.points
    packed["colors"][:, :3] = _UNCOLOURED if scan.colors is None else scan.colors
    packed["colors"][:, 3] = 255
    return fox.PointCloud(
        **_head(scan.stamp_ns, scan.frame_id),
        pose=_pose(_IDENTITY),
        point_stride=_CLOUD.itemsize,
        fields=[fox.PackedElementField(name=n, offset=o, type=t) for n, o, t in _FIELDS],
        data=packed.tobytes(),
    )


def image_message(picture: Picture) -> fox.CompressedImage:
    """Return an image as JPEG. Raises DataError as ``compressed_parts``."""
    return fox.CompressedImage(
        **_head(picture.stamp_ns, picture.frame_id),
        data=compressed_parts(picture.image, "jpeg")["data"].tobytes(),
        format="jpeg",
    )


def map_message(
    stamp_ns: int,
    frame: str,
    nodes: Floats,
    links: NDArray[np.integer],
    loops: NDArray[np.integer],
) -> fox.SceneUpdate:
    """Return nodes as dots, and links and loops as lines.

    Args:
        stamp_ns, frame: of the nodes.
        nodes: float64 (n, 2 or more), x and y in metres.
        links, loops: int (m, 2), the nodes that they join; loops are drawn wider.
    """
    size = _vector([_NODE_M] * 3)
    places = nodes[:, :2].tolist()
    dots = [
        fox.SpherePrimitive(pose=_pose((x, y, *_IDENTITY[2:])), size=size, color=_NODE)
        for x, y in places
    ]
    points = [fox.Point3(x=x, y=y, z=0.0) for x, y in places]
    links_drawn = _lines(points, links, _LINK_M, _LINK)
    loops_drawn = _lines(points, loops, 2 * _LINK_M, _LOOP)
    # Viewers replace an entity by the later one of the same id.
    return fox.SceneUpdate(
        entities=[
            fox.SceneEntity(
                **_head(stamp_ns, frame),
                id=name,
                spheres=spheres,
                lines=lines,
            )
            for name, spheres, lines in (
                ("nodes", dots, []),
                ("links", [], links_drawn),
                ("loops", [], loops_drawn),
            )
        ]
    )


def path_message(stamp_ns: int, frame: str, poses: Floats) -> fox.PosesInFrame:
    """Return a path of poses (n, 7): x, y, z and the quaternion x, y, z, w."""
    poses_shown = [_pose(pose) for pose in poses.tolist()]
    return fox.PosesInFrame(**_head(stamp_ns, frame), poses=poses_shown)


def pose_message(stamp_ns: int, frame: str, pose: Sequence[float]) -> fox.PoseInFrame:
    """Return a pose, as one of ``path_message``."""
    return fox.PoseInFrame(**_head(stamp_ns, frame), pose=_pose(pose))


def transforms_message(found: FrameTransforms) -> fox.FrameTransforms:
    """Return transforms; static ones have the stamp zero, so that they hold from the beginning."""
    return fox.FrameTransforms(
        transforms=[
            fox.FrameTransform(
                timestamp=time_of(0 if link.static else link.stamp_ns),
                parent_frame_id=plain_frame(link.parent),
                child_frame_id=plain_frame(link.child),
                translation=_vector(link.parent_from_child[:3, 3].tolist()),
                rotation=_quaternion(
                    Rotation.from_matrix(link.parent_from_child[:3, :3]).as_quat().tolist()
                ),
            )
            for link in found.transforms
        ]
    )


def text_message(stamp_ns: int, text: str, *, is_warning: bool) -> fox.Log:
    """Return a line of the log."""
    level = fox.LogLevel.Warning if is_warning else fox.LogLevel.Info
    return fox.Log(timestamp=time_of(stamp_ns), level=level, message=text, name="fusionslam")


def time_of(stamp_ns: int) -> fox.Timestamp:
    """Return a stamp as Foxglove has it: seconds of 32 bits without a sign."""
    seconds, nanoseconds = divmod(stamp_ns, NANOSECONDS)
    return fox.Timestamp(min(max(seconds, 0), _LATEST_S), nanoseconds)


def plain_frame(name: str) -> str:
    """Return a frame without the slash that tf (not tf2) wrote before it."""
    return name.lstrip("/")


def _head(stamp_ns: int, frame: str) -> dict[str, Any]:
    return {"timestamp": time_of(stamp_ns), "frame_id": plain_frame(frame)}


def _lines(
    points: list[fox.Point3], ends: NDArray[np.integer], width: float, color: fox.Color
) -> list[fox.LinePrimitive]:
    if not len(ends):
        return []
    return [
        fox.LinePrimitive(
            type=fox.LinePrimitiveLineType.LineList,
            pose=_pose(_IDENTITY),
            thickness=width,
            points=points,
            indices=ends.ravel().tolist(),
            color=color,
        )
    ]


def _pose(pose: Sequence[float]) -> fox.Pose:
    return fox.Pose(position=_vector(pose[:3]), orientation=_quaternion(pose[3:]))


def _vector(values: Sequence[float]) -> fox.Vector3:
    x, y, z = values
    return fox.Vector3(x=x, y=y, z=z)


def _quaternion(values: Sequence[float]) -> fox.Quaternion:
    x, y, z, w = values
    return fox.Quaternion(x=x, y=y, z=z, w=w)
