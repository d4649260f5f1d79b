# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Converts between Image or CompressedImage messages and pixel arrays."""

import io
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from fusionslam._core import demosaic
from fusionslam.base.files import check_pixels
from fusionslam.errors import DataError

Pixels = NDArray[np.uint8]

# Number of channels, and the indices of red, green and blue; "8UC3" has OpenCV's order.
_LAYOUTS: dict[str, tuple[int, tuple[int, ...]]] = {
    "rgb8": (3, (0, 1, 2)),
    "bgr8": (3, (2, 1, 0)),
    "8UC3": (3, (2, 1, 0)),
    "rgba8": (4, (0, 1, 2)),
    "bgra8": (4, (2, 1, 0)),
    "mono8": (1, (0,)),
    "8UC1": (1, (0,)),
}
# Two pixels in four bytes that share their chroma: positions of the first Y and of U.
_YUV = {"yuv422": (1, 0), "uyvy": (1, 0), "yuv422_yuy2": (0, 1), "yuyv": (0, 1)}
# ITU-R BT.601 with Y from 16 to 235: red, green and blue from Y, U and V.
_RGB_FROM_YUV = np.array(
    [[1.164383, 0, 1.596027], [1.164383, -0.391762, -0.812968], [1.164383, 2.017232, 0]],
    dtype=np.float32,
)
# The colours of the upper left 2x2 pixels, row by row.
_BAYER = {f"bayer_{pattern}8": pattern for pattern in ("rggb", "bggr", "gbrg", "grbg")}
# Bytes per pixel.
_CHANNELS = {name: channels for name, (channels, _) in _LAYOUTS.items()}
_CHANNELS |= dict.fromkeys(_BAYER, 1) | dict.fromkeys(_YUV, 2)
_GREY_MODES = ("L", "1")
_COLOR_MODES = ("RGB", "RGBA", "P", "LA", "PA", "CMYK", "YCbCr")
# Errors that Pillow raises on damaged pictures or on absurd declared sizes.
_UNDECODABLE = (OSError, SyntaxError, ValueError, struct.error, Image.DecompressionBombError)
# First and last bytes of JPEG and PNG pictures; cameras may append zeros.
_ENDS = ((b"\xff\xd8", b"\xff\xd9"), (b"\x89PNG\r\n\x1a\n", b"IEND\xaeB`\x82"))
_PADDING = 4096
STORED = ("raw", "jpeg", "png")
"""Formats in which pictures can be stored in a bag."""
JPEG_QUALITY = 95


def image_of(message: Any) -> Pixels:
    """Decode a sensor_msgs/Image to uint8 (H, W, 3) RGB or (H, W).

    Raises:
        DataError: the encoding is not supported, or the data is shorter than the message says.
    """
    encoding = message.encoding
    if encoding not in _CHANNELS:
        raise DataError(f"field 'encoding' is '{encoding}', expected one of {', '.join(_CHANNELS)}")
    pixels = _rows(message, _CHANNELS[encoding])
    if encoding in _BAYER:
        return demosaic(pixels[:, :, 0].copy(), _BAYER[encoding])
    if encoding in _YUV:
        return _rgb_of_yuv(pixels, *_YUV[encoding])
    order = _LAYOUTS[encoding][1]
    # A copy, so that the message's buffer can be freed.
    return (
        pixels[:, :, 0].copy()
        if len(order) == 1
        else np.stack([pixels[:, :, k] for k in order], axis=2)
    )


def check_image(message: Any) -> None:
    """Raise DataError if the data of a sensor_msgs/Image do not fit its size."""
    # Images of other encodings, such as depth, may lie in a bag unused.
    if message.encoding in _CHANNELS:
        _rows(message, _CHANNELS[message.encoding])


def _rows(message: Any, channels: int) -> Pixels:
    """View the pixels as stored, (H, W, channels), without the padding of each row."""
    height, width, step = int(message.height), int(message.width), int(message.step)
    if not height or not width:
        raise DataError(f"the image is {width}x{height}, expected at least one pixel")
    if step < width * channels:
        raise DataError(f"field 'step' is {step}, expected at least {width} pixels x {channels}")
    data = np.frombuffer(message.data, dtype=np.uint8)
    needed = (height - 1) * step + width * channels
    if len(data) < needed:
        raise DataError(
            f"field 'data' has {len(data)} bytes, expected {height * step} for {height} rows of "
            f"{step}"
        )
    return np.ndarray((height, width, channels), np.uint8, data, strides=(step, channels, 1))


def _rgb_of_yuv(pairs: Pixels, brightness: int, first_color: int) -> Pixels:
    """Convert bytes (H, W, 2), in which Y alternates with U and V in turn, to RGB."""
    if pairs.shape[1] % 2:
        raise DataError(f"the image is {pairs.shape[1]} wide, expected pairs of pixels")
    yuv = np.empty((*pairs.shape[:2], 3), np.float32)
    yuv[:, :, 0] = pairs[:, :, brightness]
    for channel in (0, 1):
        yuv[:, :, 1 + channel] = pairs[:, channel::2, first_color].repeat(2, axis=1)
    yuv -= np.array([16, 128, 128], np.float32)
    # Not a matrix product: BLAS would start all its threads for three columns.
    rgb = np.einsum("ij,hwj->hwi", _RGB_FROM_YUV, yuv)
    pixels: Pixels = np.clip(np.rint(rgb), 0, 255).astype(np.uint8)
    return pixels


def compressed_image_of(message: Any) -> Pixels:
    """Decode a sensor_msgs/CompressedImage, JPEG or PNG, to uint8 (H, W, 3) RGB or (H, W).

    Raises:
        DataError: it cannot be decoded, or does not have 8 bits per channel.
    """
    data = np.frombuffer(message.data, dtype=np.uint8).tobytes()
    if "compressedDepth" in message.format:
        raise DataError(f"field 'format' is '{message.format}', expected a JPEG or PNG picture")
    try:
        with Image.open(io.BytesIO(data), formats=("JPEG", "PNG")) as picture:
            check_pixels(picture)
            if picture.mode not in (*_GREY_MODES, *_COLOR_MODES):
                raise DataError(
                    f"the picture has pixels of mode {picture.mode}, expected 8 bits a channel"
                )
            pixels = np.array(picture.convert("L" if picture.mode in _GREY_MODES else "RGB"))
    except DataError:
        raise
    except _UNDECODABLE as error:
        raise DataError(
            f"field 'data' ({len(data)} bytes, format '{message.format}') is no JPEG or PNG "
            f"picture: {str(error).partition(' <')[0]}"
        ) from error
    # "bgr8; jpeg compressed rgb8": the encoder expects BGR but was given RGB.
    swapped = "rgb8" in message.format.partition("compressed")[2]
    return np.ascontiguousarray(pixels[:, :, ::-1]) if swapped and pixels.ndim == 3 else pixels


def check_compressed_image(message: Any) -> None:
    """Raise DataError if a sensor_msgs/CompressedImage in JPEG or PNG is no such picture, or cut.

    Only pictures that do not begin and end as they should are decoded, which takes long.
    """
    data, name = np.frombuffer(message.data, dtype=np.uint8), message.format.lower()
    if "compresseddepth" in name or not any(each in name for each in ("jpeg", "jpg", "png")):
        return
    start, end = data[:8].tobytes(), data[-_PADDING:].tobytes().rstrip(b"\0")
    if not any(start.startswith(first) and end.endswith(last) for first, last in _ENDS):
        compressed_image_of(message)


def image_parts(image: Pixels) -> dict[str, Any]:
    """Fields of a sensor_msgs/Image except its header."""
    _check_pixels(image)
    return {
        "height": image.shape[0],
        "width": image.shape[1],
        "encoding": "rgb8" if image.ndim == 3 else "mono8",
        "is_bigendian": 0,
        "step": image[0].size,
        "data": np.ascontiguousarray(image).reshape(-1),
    }


def compressed_parts(image: Pixels, stored: str) -> dict[str, Any]:
    """Fields of a sensor_msgs/CompressedImage except its header; ``stored``: "jpeg" or "png"."""
    _check_pixels(image)
    memory = io.BytesIO()
    quality = {"quality": JPEG_QUALITY} if stored == "jpeg" else {"compress_level": 1}
    Image.fromarray(np.ascontiguousarray(image)).save(memory, stored.upper(), **quality)
    # As ROS's image_transport writes it: original encoding; encoding given to the encoder.
    original, given = ("rgb8", "bgr8") if image.ndim == 3 else ("mono8", "mono8")
    return {
        "format": f"{original}; {stored} compressed {given}",
        "data": np.frombuffer(memory.getvalue(), dtype=np.uint8),
    }


def _check_pixels(image: Pixels) -> None:
    shape = image.shape
    if image.dtype != np.uint8 or not (len(shape) == 2 or shape[2:] == (3,)) or not image.size:
        raise DataError(
            f"an image of shape {shape} and {image.dtype}, expected uint8 (H, W, 3) or (H, W)"
        )
