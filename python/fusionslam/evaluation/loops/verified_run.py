# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``VerifiedRun``: the loops of a whole recording that registration verified."""

import os
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.archive import check_types, join_parts, load_archive, part_of, save_archive
from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Floats, Integers, Mask
from fusionslam.base.texts import counted
from fusionslam.errors import DataError, ShapeError
from fusionslam.evaluation.loops.descriptor_run import DescriptorRun
from fusionslam.evaluation.loops.nearest_matches import Matches, check_rigid

FORMAT = "fusionslam.verified_run.1"
REJECTED = np.dtype(
    [("query", np.int64), ("match", np.int64), ("code", "U32"), ("number", np.float64)]
)
"""A rejected candidate: rows of the run, and code and number of the reason
(``fusionslam.registration.Refusal``)."""

_TEXTS = ("source", "descriptors", "dataset", "config", "skipped", "recorded")
_SHAPES: dict[str, tuple[type[np.generic], tuple[int, ...]]] = {
    "frames": (np.int64, ()),
    "numbers": (np.int64, ()),
    "stamps_ns": (np.int64, ()),
    "points": (np.int64, ()),
    "match": (np.int64, ()),
    "match_from_query": (np.float64, (4, 4)),
    "covariance": (np.float64, (6, 6)),
    "overlap": (np.float64, ()),
    "probability": (np.float64, ()),
    "distance": (np.float64, ()),
    "accepted": (np.bool_, ()),
}
_OPTIONAL = ("poses", "body_from_cloud")


@checked
@dataclass(frozen=True, eq=False, kw_only=True)
class VerifiedRun:
    """The best loop of each frame of a sequence, after the registration of its candidates.

    Frames are queries, in order of time; matches and candidates are rows of earlier ones.

    Attributes:
        source: "lidar", "stereo" or "cloud", as of ``DescriptorRun``.
        descriptors: names of those that proposed candidates, such as ("cm2dp", "scan_context").
        dataset: name of the dataset.
        frames: int64 (N,), indices into the dataset.
        numbers: int64 (N,), frame numbers of the file names.
        stamps_ns: int64 (N,), nanoseconds.
        poses: float64 (N, 4, 4), world_from_body, or None without ground truth.
        body_from_cloud: float64 (N, 4, 4), maps the frame of the clouds to that body; None if it
            is unknown, so that no pose can be judged.
        points: int64 (N,), number of points of the clouds.
        match: int64 (N,), row of the most probable candidate; -1 where there is none.
        match_from_query: float64 (N, 4, 4), pose of the query's cloud in the frame of the match's;
            NaN where registration estimated none.
        covariance: float64 (N, 6, 6), of that pose's error, as of ``Registration``; NaN where it
            is not known.
        overlap: float64 (N,), of both clouds at that pose; NaN without a match.
        probability: float64 (N,), that the pose is right; NaN without a match.
        distance: float64 (N,), descriptor distance of the match, as of ``Loop``; inf without a
            match, or of one that only another descriptor found.
        accepted: bool (N,), whether the detector took the match for a loop.
        candidates: int64 (N, k), all that were compared, the most promising first;
            -1 where there are fewer than k.
        rejected: of dtype ``REJECTED``, candidates whose registration was refused.
        seconds: wall time by stage ("load", "fuse", "describe", "match", "register"), float64 (N,)
            each.
        config: the effective configuration, in types that JSON can hold.
        skipped: number -> reason, for frames left out because they cannot be described.
        recorded: number of frames of the whole recording; None if unknown.

    Raises:
        ShapeError: an array whose shape does not fit the others', or ``rejected`` of another type.
        DataError: a match, candidate or rejected candidate that is no earlier frame, a match
            without a probability, an accepted loop without a pose, or a pose that is none.
    """

    source: str
    descriptors: tuple[str, ...]
    dataset: str
    frames: Integers
    numbers: Integers
    stamps_ns: Integers
    poses: Floats | None = None
    body_from_cloud: Floats | None = None
    points: Integers
    match: Integers
    match_from_query: Floats
    covariance: Floats
    overlap: Floats
    probability: Floats
    distance: Floats
    accepted: Mask
    candidates: Integers
    rejected: NDArray[np.void] = field(default_factory=lambda: np.empty(0, REJECTED))
    seconds: dict[str, Floats] = field(default_factory=dict)
    config: dict[str, Any] = field(default_factory=dict)
    skipped: dict[int, str] = field(default_factory=dict)
    recorded: int | None = None

    def __post_init__(self) -> None:
        count = len(self)
        arrays = {name: (getattr(self, name), shape) for name, (_, shape) in _SHAPES.items()}
        arrays |= {f"seconds[{stage!r}]": (values, ()) for stage, values in self.seconds.items()}
        arrays |= {
            name: (getattr(self, name), (4, 4))
            for name in _OPTIONAL
            if getattr(self, name) is not None
        }
        for name, (array, shape) in arrays.items():
            if np.shape(array) != (count, *shape):
                raise ShapeError(f"{name}: shape {np.shape(array)}, expected {(count, *shape)}")
        if self.candidates.ndim != 2 or len(self.candidates) != count:
            raise ShapeError(f"candidates: shape {self.candidates.shape}, expected ({count}, k)")
        if self.rejected.ndim != 1 or self.rejected.dtype != REJECTED:
            raise ShapeError(
                f"rejected: {self.rejected.dtype} {self.rejected.shape}, expected {REJECTED} (M,)"
            )
        if self.body_from_cloud is not None:
            check_rigid("body_from_cloud", self.body_from_cloud)
        self._check_rows()
        self._check_matches()

    def _check_rows(self) -> None:
        """Matches and candidates must be earlier frames."""
        queries, rejected = np.arange(len(self)), self.rejected
        pairs = {
            "match": (queries, self.match, -1),
            "candidates": (queries[:, None], self.candidates, -1),
            "rejected": (rejected["query"], rejected["match"], 0),
        }
        for name, (query, match, least) in pairs.items():
            wrong = (match < least) | (match >= query) | (query >= len(self))
            if wrong.any():
                row = np.argwhere(wrong)[0].tolist()
                raise DataError(
                    f"{name}: {match[tuple(row)]} at {row}, expected "
                    f"{'-1 or ' if least else ''}the row of an earlier frame",
                    code="wrong-row",
                    fields=(name, str(row[0])),
                )

    def _check_matches(self) -> None:
        """Each match has a probability, each accepted one a pose, and nothing else has either."""
        matched = self.match >= 0
        posed = ~np.isnan(self.match_from_query).all(axis=(1, 2))
        for name, wrong, expected in (
            (
                "probability",
                matched != ((self.probability >= 0) & (self.probability <= 1)),
                "0 to 1 where there is a match, else NaN",
            ),
            (
                "distance",
                np.isnan(self.distance) | (~matched & (self.distance < np.inf)),
                "a distance, inf where there is no match",
            ),
            ("accepted", self.accepted & ~posed, "False where there is no pose"),
        ):
            for row in np.flatnonzero(wrong).tolist():
                raise DataError(
                    f"{name}: row {row} is {getattr(self, name)[row]}, expected {expected}",
                    code="wrong-match",
                    fields=(name, str(row)),
                )
        self._matches(self.match_from_query)

    def __repr__(self) -> str:
        poses = "without" if self.poses is None else "with"
        return (
            f"<VerifiedRun of {self.dataset}: {self.descriptor}, {self.source} clouds, "
            f"{counted(len(self), 'frame')}, {counted(int(self.accepted.sum()), 'loop')}, "
            f"{poses} poses>"
        )

    def __len__(self) -> int:
        return len(self.match)

    @property
    def descriptor(self) -> str:
        """The descriptors that proposed candidates, in one word: "cm2dp+scan_context"."""
        return "+".join(self.descriptors)

    @property
    def preset(self) -> None:
        """None: descriptors with another preset than the default one bear it in their name."""

    @property
    def name(self) -> str:
        """As of ``DescriptorRun``, to tell runs apart: "verified cm2dp+scan_context"."""
        return f"verified {self.descriptor}"

    @property
    def positions(self) -> Floats | None:
        """float64 (N, 3), metres, in the world frame; None without ground truth."""
        return None if self.poses is None else self.poses[:, :3, 3]

    @property
    def matches(self) -> Matches:
        """The matches with 1 - probability as distance, and the poses of the body.

        The poses are None where ``body_from_cloud`` is.
        """
        body = self.body_from_cloud
        if body is None:
            return self._matches(None)
        return self._matches(body[self.match] @ self.match_from_query @ np.linalg.inv(body))

    def _matches(self, poses: Floats | None) -> Matches:
        apart = np.where(self.match >= 0, 1 - self.probability, np.inf).astype(np.float32)
        return Matches(
            self.match[:, None], apart[:, None], None if poses is None else poses[:, None]
        )

    def only(self, rows: Integers) -> "VerifiedRun":
        """The run of the frames in some rows, int64 (M,), ascending.

        A match or candidate that is not among them is none.
        """
        new = np.full(len(self) + 1, -1)  # the last one is that of -1
        new[rows] = np.arange(len(rows))
        changes = {name: getattr(self, name)[rows] for name in _SHAPES}
        changes |= {
            name: None if getattr(self, name) is None else getattr(self, name)[rows]
            for name in _OPTIONAL
        }
        changes["match"] = new[changes["match"]]
        lost = changes["match"] < 0
        for name in ("match_from_query", "covariance", "overlap", "probability"):
            changes[name][lost] = np.nan
        changes["distance"][lost], changes["accepted"][lost] = np.inf, False
        rejected = self.rejected.copy()
        for column in ("query", "match"):
            rejected[column] = new[rejected[column]]
        return replace(
            self,
            **changes,
            candidates=new[self.candidates[rows]],
            rejected=rejected[(rejected["query"] >= 0) & (rejected["match"] >= 0)],
            seconds={stage: values[rows] for stage, values in self.seconds.items()},
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write one .npz, whole or not at all. Raises DataError if that fails."""
        names = (*_SHAPES, *_OPTIONAL, "candidates", "rejected")
        arrays = {name: getattr(self, name) for name in names}
        arrays |= join_parts({"seconds": self.seconds})
        about = {name: getattr(self, name) for name in _TEXTS}
        save_archive(path, FORMAT, about, arrays, compress=True)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "VerifiedRun":
        """Read what ``save`` wrote.

        Raises:
            DataError: the file is missing, truncated or of another kind; the message names it.
        """
        with load_archive(path, FORMAT, "a stored run of verified loops") as (about, stored):
            about["skipped"] = {int(number): why for number, why in about["skipped"].items()}
            about["descriptors"] = tuple(about["descriptors"])
            values: dict[str, Any] = {
                name: stored[name].astype(kind, copy=False) for name, (kind, _) in _SHAPES.items()
            }
            values["candidates"] = stored["candidates"].astype(np.int64, copy=False)
            values["rejected"] = stored["rejected"].astype(REJECTED, copy=False)
            values |= {
                name: stored[name].astype(np.float64, copy=False)
                for name in _OPTIONAL
                if name in stored
            }
            return check_types(cls(**about, **values, seconds=part_of(stored, "seconds")))


LoopRun = DescriptorRun | VerifiedRun
"""What an ``Evaluation`` is of."""
