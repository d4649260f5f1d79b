# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""ROS messages as values: every layout that is read, and what is refused."""

import io
import struct
import zlib
from types import SimpleNamespace as Message
from typing import Any

import numpy as np
import pytest
from PIL import Image

from bags import OPTICAL, START, camera_info, odometry, same, scan
from fusionslam.datasets.bags.messages import MessageBuilder, value_of
from fusionslam.errors import DataError
from fusionslam.sensors.messages import Fix, FrameTransform, FrameTransforms, Picture, Scan
from rows import rows

HEADER = Message(stamp=Message(sec=1_700_000_000, nanosec=5), frame_id="velodyne")
STAMP = 1_700_000_000_000_000_005


def field(name: str, offset: int, datatype: int, count: int = 1) -> Message:
    return Message(name=name, offset=offset, datatype=datatype, count=count)


def cloud(cells: np.ndarray, fields: list[Message], **changes: Any) -> Message:
    """A PointCloud2 of a structured array (height, width)."""
    (height, width), step = cells.shape, cells.dtype.itemsize
    values = {"header": HEADER, "height": height, "width": width, "fields": fields}
    values |= {"is_bigendian": False, "point_step": step, "row_step": step * width}
    return Message(**values | {"data": cells.tobytes(), "is_dense": False} | changes)


def read_cloud(message: Message) -> Scan:
    value = value_of(message, "sensor_msgs/PointCloud2", "/points")
    assert isinstance(value, Scan)
    return value


@rows("order", "<>")
@rows("code, float_type", [(7, "f4"), (8, "f8")])
def test_fields_are_found_by_their_offsets_whatever_their_order_and_endianness(
    order: str, code: int, float_type: str
) -> None:
    names = ["ring", "z", "x", "y", "t"]
    formats = [f"{order}{form}" for form in ("u2", float_type, float_type, float_type, "u4")]
    offsets = [1, 4, 20, 12, 30]
    layout = {"names": names, "formats": formats, "offsets": offsets, "itemsize": 37}
    cells = np.zeros((1, 5), np.dtype(layout))
    for k, name in enumerate(names):
        cells[name] = np.arange(5) + 10 * k
    cells["x"][0, 2] = np.nan
    codes = (4, code, code, code, 6)
    fields = [field(*each) for each in zip(names, offsets, codes, strict=True)]
    value = read_cloud(cloud(cells, fields, is_bigendian=order == ">"))
    expected = np.stack([np.arange(5) + 10.0 * k for k in (2, 3, 1)], axis=1).astype(np.float32)
    expected[2, 0] = np.nan
    np.testing.assert_array_equal(value.points, expected)
    assert value.points.dtype == np.float32 and value.stamp_ns == STAMP
    np.testing.assert_array_equal(value.fields["ring"], np.arange(5, dtype=np.uint16))
    assert value.fields["t"].dtype == np.uint32 and value.width == 0


XYZ = [field("x", 0, 7), field("y", 4, 7), field("z", 8, 7)]
PLACE: list[Any] = [("x", "f4"), ("y", "f4"), ("z", "f4")]


def test_rows_of_an_organised_cloud_may_be_padded() -> None:
    cells = np.zeros((2, 3), PLACE)
    cells["x"] = [[1, 2, 3], [4, 5, 6]]
    padded = b"".join(row.tobytes() + b"\xff" * 8 for row in cells)
    value = read_cloud(cloud(cells, XYZ, data=padded, row_step=44))
    assert value.points[:, 0].tolist() == [1, 2, 3, 4, 5, 6] and value.width == 3


@rows("code", [6, 7])
def test_packed_colours_are_unpacked_even_where_they_are_no_number_as_floats(code: int) -> None:
    cells = np.zeros((1, 2), [*PLACE, ("rgb", "u4")])
    cells["rgb"] = [[0x00C81E14, 0xFFFFFFFE]]
    value = read_cloud(cloud(cells, [*XYZ, field("rgb", 12, code)]))
    assert value.colors is not None
    assert value.colors.tolist() == [[200, 30, 20], [255, 255, 254]]
    assert not value.fields


def test_a_field_of_several_values_becomes_several_and_padding_none() -> None:
    cells = np.zeros((1, 2), [*PLACE, ("n", "f4", 2), ("p", "u1", 4)])
    cells["n"] = [[[1, 2], [3, 4]]]
    value = read_cloud(cloud(cells, [*XYZ, field("n", 12, 7, 2), field("_", 20, 2, 4)]))
    found = {name: list(values) for name, values in value.fields.items()}
    assert found == {"n_0": [1, 3], "n_1": [2, 4]}
    assert read_cloud(cloud(np.zeros((1, 0), PLACE), XYZ)).points.shape == (0, 3)


@rows(
    "changes, word",
    [
        ({"data": b"\0" * 23}, "'data'"),
        ({"fields": XYZ[:2]}, "expected x, y, z"),
        ({"fields": [*XYZ, field("t", 10, 6)]}, "'t'"),
        ({"fields": [*XYZ, field("t", 0, 9)]}, "'t'"),
        ({"fields": [field("x", 0, 5), *XYZ[1:]]}, "'x' is int32"),
        ({"fields": [*XYZ, XYZ[0]]}, "x, y, z, x"),
        ({"height": 2, "row_step": 20}, "'row_step'"),
    ],
)
def test_a_cloud_that_contradicts_itself_names_the_field(
    changes: dict[str, Any], word: str
) -> None:
    with pytest.raises(DataError) as error:
        read_cloud(cloud(np.zeros((1, 2), PLACE), **{"fields": XYZ} | changes))
    assert word in str(error.value)
    assert str(error.value).startswith("/points at 1700000000.000000005 s: ")


def image(encoding: str, pixels: np.ndarray, padding: int = 0, **changes: Any) -> Message:
    lines = pixels.reshape(len(pixels), -1)
    padded = np.pad(lines, ((0, 0), (0, padding)), constant_values=77)
    values = {"header": HEADER, "height": pixels.shape[0], "width": pixels.shape[1]}
    values |= {"encoding": encoding, "is_bigendian": 0, "step": padded.shape[1]}
    return Message(**values | {"data": padded.tobytes()} | changes)


def read_image(message: Message, kind: str = "Image") -> np.ndarray:
    value = value_of(message, f"sensor_msgs/msg/{kind}", "/image")
    assert isinstance(value, Picture)
    return value.image


RGB = np.random.default_rng(1).integers(0, 256, (5, 7, 3), dtype=np.uint8)
ALPHA = np.full((5, 7, 1), 9, np.uint8)


@rows("padding", [0, 5])
@rows(
    "encoding, stored",
    [
        ("rgb8", RGB),
        ("bgr8", RGB[..., ::-1]),
        ("8UC3", RGB[..., ::-1]),
        ("rgba8", np.dstack([RGB, ALPHA])),
        ("bgra8", np.dstack([RGB[..., ::-1], ALPHA])),
        ("mono8", RGB[..., 0]),
    ],
)
def test_raw_images_become_rgb_or_stay_grey(
    encoding: str, stored: np.ndarray, padding: int
) -> None:
    expected = stored if encoding == "mono8" else RGB
    np.testing.assert_array_equal(read_image(image(encoding, stored, padding)), expected)


@rows("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_a_bayer_mosaic_of_one_colour_gives_that_colour(pattern: str) -> None:
    color = {"r": 200, "g": 90, "b": 20}
    cell = np.array([color[name] for name in pattern], np.uint8).reshape(2, 2)
    found = read_image(image(f"bayer_{pattern}8", np.tile(cell, (4, 5)), 2))
    np.testing.assert_array_equal(found, np.tile(np.uint8([200, 90, 20]), (8, 10, 1)))


@rows("padding", [0, 3])
@rows(
    "encoding, order",
    [("yuv422", "UYVY"), ("uyvy", "UYVY"), ("yuv422_yuy2", "YUYV"), ("yuyv", "YUYV")],
)
def test_pixels_that_share_a_colour_become_rgb(encoding: str, order: str, padding: int) -> None:
    """The bars of ITU-R BT.601, two pixels wide; then black and white beside each other."""
    bars = {(81, 90, 240): (255, 0, 0), (145, 54, 34): (0, 255, 0)}
    bars |= {(41, 240, 110): (0, 0, 255), (210, 16, 146): (255, 255, 0)}
    row, expected = [], []
    for (y, u, v), color in bars.items():
        row += [{"Y": y, "U": u, "V": v}[name] for name in order]
        expected += [color, color]
    first, second = iter((16, 235)), [(0, 0, 0), (255, 255, 255)]
    row += [next(first) if name == "Y" else 128 for name in order]
    stored = np.array([row, row], np.uint8)
    message = image(encoding, stored.reshape(2, 10, 2), padding)
    found = read_image(message).astype(int)
    assert found.shape == (2, 10, 3)
    assert np.abs(found - np.array([expected + second] * 2)).max() <= 2


def compressed(pixels: np.ndarray, form: str, text: str) -> Message:
    memory = io.BytesIO()
    Image.fromarray(pixels).save(memory, form)
    return Message(header=HEADER, format=text, data=memory.getvalue())


@rows(
    "text, order",
    [("rgb8; jpeg compressed bgr8", 1), ("jpeg", 1), ("bgr8; jpeg compressed rgb8", -1)],
)
def test_jpeg_colours_are_those_that_the_format_says_were_encoded(text: str, order: int) -> None:
    flat = np.tile(np.uint8([200, 90, 20]), (16, 16, 1))
    found = read_image(compressed(flat, "JPEG", text), "CompressedImage").astype(int)
    assert np.abs(found[..., ::order] - [200, 90, 20]).max() <= 4


def test_png_pictures_are_read_bit_for_bit() -> None:
    for pixels in (RGB, np.ascontiguousarray(RGB[..., 0])):
        message = compressed(pixels, "PNG", "rgb8; png compressed bgr8")
        np.testing.assert_array_equal(read_image(message, "CompressedImage"), pixels)


@rows(
    "message, word",
    [
        (image("16UC1", RGB), "'16UC1'"),
        (image("mono16", RGB), "'mono16'"),
        (image("yuv422", RGB[..., :2]), "7 wide"),
        (image("rgb8", RGB, data=b"\0" * 104), "'data'"),
        (image("rgb8", RGB, step=20), "'step'"),
        (image("mono8", RGB[..., 0], height=0), "7x0"),
    ],
)
def test_an_image_that_cannot_be_read_names_the_field(message: Message, word: str) -> None:
    with pytest.raises(DataError, match=r"/image .*1700000000\.000000005 s") as error:
        read_image(message)
    assert word in str(error.value)


@rows(
    "data, text, word",
    [
        (b"\xff\xd8\xff broken", "jpeg", "'data'"),
        (b"", "png", "0 bytes"),
        (b"", "16UC1; compressedDepth", "compressedDepth"),
    ],
)
def test_a_compressed_image_that_is_damaged_is_refused(data: bytes, text: str, word: str) -> None:
    with pytest.raises(DataError, match=word):
        read_image(Message(header=HEADER, format=text, data=data), "CompressedImage")


def test_a_png_of_an_absurd_size_or_of_sixteen_bits_is_refused() -> None:
    message = compressed(RGB, "PNG", "png")
    header = b"IHDR" + struct.pack(">II", 60_000, 60_000) + message.data[24:29]
    checked = header + struct.pack(">I", zlib.crc32(header))
    message.data = message.data[:12] + checked + message.data[33:]
    deep = compressed(np.zeros((4, 4), np.uint16), "PNG", "png")
    for refused, words in ((message, "'data'"), (deep, "I;16")):
        with pytest.raises(DataError, match=words):
            read_image(refused, "CompressedImage")


@rows("ros", [1, 2])
def test_values_survive_being_messages(ros: Any) -> None:
    builder = MessageBuilder(lambda name, /, **fields: Message(**fields), ros)
    moving = FrameTransform(stamp_ns=START, parent="odom", child="base", parent_from_child=OPTICAL)
    for name, value in (
        ("sensor_msgs/PointCloud2", scan()),
        ("sensor_msgs/CameraInfo", camera_info(distortion_model="equidistant")),
        ("nav_msgs/Odometry", odometry(START + 5)),
        ("tf2_msgs/TFMessage", FrameTransforms(transforms=(moving,))),
        ("sensor_msgs/Image", Picture(stamp_ns=STAMP, frame_id="camera", image=RGB)),
        ("sensor_msgs/NavSatFix", fix()),
        ("sensor_msgs/NavSatFix", fix(covariance=None)),
        ("sensor_msgs/NavSatFix", fix(position=None, covariance=None)),
    ):
        message = builder.build(value)
        assert same(value_of(message, name, "/tf"), value), name
        is_ros1_camera = hasattr(message, "K")
        assert is_ros1_camera == (ros == 1 and "CameraInfo" in name)
    header = Message(stamp=Message(secs=3, nsecs=4), frame_id="camera")  # as rospy calls them
    value = value_of(image("rgb8", RGB, header=header), "sensor_msgs/Image", "/i")
    assert value.stamp_ns == 3_000_000_004


def fix(**changes: Any) -> Fix:
    values = {"position": np.array([49.0, 8.4, 110.0]), "covariance": np.diag([1.0, 1.0, 4.0])}
    return Fix(stamp_ns=STAMP, frame_id="gps", **values | changes)


@rows(
    "changes, code, field",
    [
        ({"latitude": 5_427_000.0}, "no-wgs84", "latitude"),
        ({"longitude": 181.0}, "no-wgs84", "longitude"),
        ({"altitude": np.nan}, "data", None),
        ({"position_covariance": np.zeros(9)}, "not-positive-definite", "position_covariance"),
        ({"position_covariance": np.full(9, np.inf)}, "data", None),
    ],
)
def test_fixes_that_cannot_be_are_named(
    changes: dict[str, Any], code: str, field: str | None
) -> None:
    message = MessageBuilder(lambda name, /, **fields: Message(**fields), 2).build(fix())
    vars(message).update(changes)
    with pytest.raises(DataError, match=r"/gps at 1700000000\.000000005 s: ") as error:
        value_of(message, "sensor_msgs/NavSatFix", "/gps")
    assert error.value.code == code and error.value.fields == (() if field is None else (field,))


def test_a_receiver_without_a_fix_has_no_position_whatever_it_writes() -> None:
    message = MessageBuilder(lambda name, /, **fields: Message(**fields), 2).build(fix())
    message.status.status = -1
    value = value_of(message, "sensor_msgs/NavSatFix", "/gps")
    assert isinstance(value, Fix) and value.position is None and value.covariance is None


def test_a_quaternion_need_not_be_of_unit_length_but_has_to_be_a_rotation() -> None:
    message = MessageBuilder(lambda name, /, **fields: Message(**fields), 2).build(odometry(START))
    turn = message.pose.pose.orientation
    turn.x, turn.y, turn.z, turn.w = 0.0, 0.0, 3.0, 3.0
    pose = value_of(message, "nav_msgs/Odometry", "/odom").pose
    np.testing.assert_allclose(pose[:3, :3], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)
    turn.z = turn.w = 0.0
    with pytest.raises(DataError, match=r"/odom.*pose"):
        value_of(message, "nav_msgs/Odometry", "/odom")
