# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Values that break careless code, as Hypothesis strategies."""

from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st

from fusionslam.errors import FusionSlamError

# Atheris chooses the bytes that Hypothesis draws from: nothing is stored, timed or made smaller.
GENERATE = settings(
    database=None,
    deadline=None,
    phases=[Phase.generate],
    suppress_health_check=list(HealthCheck),
)


def driven_by_bytes(test: Callable[..., None]) -> Callable[[bytes], bytes | None]:
    """A Hypothesis test as a function of the bytes that it draws from."""
    function: Callable[[bytes], bytes | None] = vars(test)["hypothesis"].fuzz_one_input
    return function


def random_bytes() -> list[bytes]:
    """Seeds that are long enough for Hypothesis to draw from."""
    return [np.random.default_rng(number).bytes(256) for number in range(64)]


HOSTILE_JSON: tuple[Any, ...] = (
    None, True, -1, 0, 1, 2**31, 2**63, -(2**63), 10**400, 1e308, -1e308, 1e-320, 0.5,
    "", "x", "9" * 400, "\x00", "../../x", "<script>", [], [[]], {}, {"a": {}},
)  # fmt: skip
LARGEST = 1_000_000  # values of an array
HOSTILE_DTYPES = ("f8", "f4", "i8", "i4", "u1", "u8", "?", "U3", "S3", ">f8", "c16", "M8[s]", "f2")
HOSTILE_NUMBERS = (np.nan, np.inf, -np.inf, -1, 0, 1, 2**31, 2**62, 1e300, -1e300, 1e-300, 255)


@st.composite
def hostile_arrays(draw: st.DrawFn, array: np.ndarray[Any, Any]) -> Any:
    """An array with other values, another dtype or another shape; None to leave it out."""
    kind = draw(
        st.sampled_from(["values", "dtype", "shape", "missing", "scalar", "long", "layout"])
    )
    if kind == "missing":
        return None
    if kind == "scalar":
        return np.array(draw(st.sampled_from([0, 1.5, "x", b"x", True, 2**60])))
    if kind == "long":
        # A gigabyte would take seconds to store, and shows no more.
        most = LARGEST // max(int(np.prod(array.shape[1:])), 1)
        rows = min(draw(st.sampled_from([1, 7, 1000, 100_000])), most)
        return np.zeros((rows, *array.shape[1:]), "f8")
    if kind == "layout":
        wide = np.repeat(array, 2, axis=-1)[..., ::2] if array.ndim else array
        views: list[Any] = [wide, np.asfortranarray(array), array[::-1] if array.ndim else array]
        views += [np.broadcast_to(array[:1], array.shape)] if array.ndim and len(array) else []
        return draw(st.sampled_from(views))
    if kind == "dtype":
        with np.errstate(all="ignore"):
            try:
                return array.astype(draw(st.sampled_from(HOSTILE_DTYPES)))
            except (TypeError, ValueError, RuntimeError):  # the last of times as short bytes
                return None
    if kind == "shape":
        changes: list[Callable[[], Any]] = [
            lambda: array.reshape(-1),
            lambda: array[None],
            lambda: array[..., None],
            lambda: array[:0],
            lambda: array[: max(len(array) - 1, 0)] if array.ndim else array,
            lambda: np.concatenate([array, array]) if array.ndim else array,
            lambda: array.T,
        ]
        return draw(st.sampled_from(changes))() if array.ndim else array[None]
    copy = np.array(array)
    flat = copy.reshape(-1)
    for _ in range(draw(st.integers(1, 3)) if flat.size else 0):
        place = draw(st.integers(0, flat.size - 1))
        _put(flat, place, draw(st.sampled_from(HOSTILE_NUMBERS)), draw)
    return copy


def _put(flat: Any, place: int, number: float, draw: st.DrawFn) -> None:
    names = flat.dtype.names
    target = flat[draw(st.sampled_from(names))] if names else flat
    target = target.reshape(len(flat), -1)[place]
    if target.dtype.kind in "fiub?":
        with np.errstate(all="ignore"):
            target[...] = np.float64(number).astype(target.dtype)


@st.composite
def hostile(draw: st.DrawFn, value: Any) -> Any:
    """A hostile value in place of a valid one, of its kind more often than not."""
    if draw(st.integers(0, 9)) == 0:
        return draw(st.sampled_from([None, "x", b"x", [], {}, (1, 2), 1.5, object, np.zeros(3)]))
    if isinstance(value, np.ndarray):
        return draw(hostile_arrays(value))
    if isinstance(value, bool):
        return draw(st.sampled_from([True, False, 2, -1, None, "yes"]))
    if isinstance(value, int | float):
        return draw(st.sampled_from(_NUMBERS) | st.integers(-9, 99) | st.floats())
    if isinstance(value, str):
        return draw(st.sampled_from(_TEXTS) | st.text(max_size=5))
    if isinstance(value, list | tuple):
        return draw(st.sampled_from([[], list(value)[:1], list(value) * 2, [None], ["x"]]))
    if isinstance(value, Mapping):
        return {key: draw(hostile(item)) for key, item in value.items()}
    if is_dataclass(value) and not isinstance(value, type):
        names = [field.name for field in fields(value) if field.init]
        name = draw(st.sampled_from(names))
        try:
            return replace(value, **{name: draw(hostile(getattr(value, name)))})
        except FusionSlamError:  # refused already
            return value
    return None


_NUMBERS: tuple[Any, ...] = (
    0, 1, -1, 2**31 - 1, 2**31, 2**32 + 8, 2**63 - 1, 2**63, -(2**63), 10**400, np.nan, np.inf,
    -np.inf, 1e300, -1e300, 1e-300, 0.5, np.float32(3), np.int8(3), np.uint64(2**63), True,
)  # fmt: skip
_TEXTS = (
    "",
    "z",
    "robust",
    "upright",
    "paper",
    "author",
    "rgb",
    "lab",
    "\x00",
    "../../etc/passwd",
    "é" * 9,
)


class Forged:
    """A target that changes values of valid input: refused, or something that works."""

    def __init__(self) -> None:
        self._run: Callable[[bytes], bytes | None] | None = None
        self._accepted: bool | None = None

    def __call__(self, data: bytes) -> bool | None:
        self._accepted = None
        if self._run is None:
            self._run = self._prepare()
        self._run(data)
        return self._accepted

    def _prepare(self) -> Callable[[bytes], bytes | None]:
        """Return what runs one input and sets ``_accepted``."""
        raise NotImplementedError
