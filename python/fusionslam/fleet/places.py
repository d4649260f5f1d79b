# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Places of a fleet: what is added to a database of them, what it finds, and what it is asked."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from fusionslam.base.arrays import Floats, Floats32, Integers, Matrix

ABOUT = ("session", "robot", "site", "region")
"""What is known of a place's recording: its name, who drove, and where."""


@dataclass(frozen=True)
class Places:
    """Places to add to a database, each described by one vector.

    Attributes:
        keys: their names, each place's own; those of ``fusionslam fleet`` are CHUNK:ROW.
        vectors: descriptors, float32 (n, D).
        stamps_ns: int64 (n), when they were seen.
        frames: int64 (n), numbers of the frames in their recording.
        session: name of the recording, one for all or one for each.
        robot, site, region: the same; "" where they are unknown.
        poses: float64 (n, 4, 4), site_from_robot in a frame of the recording; NaN where unknown.
    """

    keys: Sequence[str]
    vectors: Floats32
    stamps_ns: Integers
    frames: Integers
    session: str | Sequence[str]
    robot: str | Sequence[str] = ""
    site: str | Sequence[str] = ""
    region: str | Sequence[str] = ""
    poses: Floats | None = None

    def __len__(self) -> int:
        return len(self.keys)

    def take(self, rows: Integers) -> "Places":
        """Return the places of some rows."""
        chosen = rows.tolist()
        about = {name: [self.column(name)[row] for row in chosen] for name in ABOUT}
        return Places(
            keys=[self.keys[row] for row in chosen],
            vectors=self.vectors[rows],
            stamps_ns=self.stamps_ns[rows],
            frames=self.frames[rows],
            poses=None if self.poses is None else self.poses[rows],
            **about,
        )

    def column(self, name: str) -> list[str]:
        """Return one of ``ABOUT`` for each place."""
        value: str | Sequence[str] = getattr(self, name)
        return [value] * len(self) if isinstance(value, str) else list(value)


def join_places(parts: Sequence[Places]) -> Places | None:
    """Return the places of several parts together; None if there are none."""
    parts = [part for part in parts if len(part)]
    if not parts:
        return None
    unknown = np.full((1, 4, 4), np.nan)
    poses = [np.repeat(unknown, len(e), axis=0) if e.poses is None else e.poses for e in parts]
    about = {name: [text for part in parts for text in part.column(name)] for name in ABOUT}
    return Places(
        keys=[key for part in parts for key in part.keys],
        vectors=np.concatenate([part.vectors for part in parts]),
        stamps_ns=np.concatenate([part.stamps_ns for part in parts]),
        frames=np.concatenate([part.frames for part in parts]),
        poses=np.concatenate(poses),
        **about,
    )


@dataclass(frozen=True)
class Candidate:
    """A place that looks like a query.

    Attributes:
        key: of the place.
        distance: of both descriptors, exact.
        session, robot, site, region: of its recording.
        frame: its number in the recording.
        stamp_ns: when it was seen.
        pose: float64 (4, 4), site_from_robot in a frame of its recording; None if unknown.
    """

    key: str
    distance: float
    session: str
    robot: str
    site: str
    region: str
    frame: int
    stamp_ns: int
    pose: Matrix | None = None


@dataclass(frozen=True)
class PlaceFilter:
    """Which places are meant: those of which all that is given holds; None is any.

    Attributes:
        site, region, robot, session: as of ``Places``.
        not_session: of any recording but this one.
        since_ns, until_ns: seen at or after, and before, these times.
    """

    site: str | None = None
    region: str | None = None
    robot: str | None = None
    session: str | None = None
    not_session: str | None = None
    since_ns: int | None = None
    until_ns: int | None = None

    @property
    def is_any(self) -> bool:
        """Whether nothing is given."""
        return all(getattr(self, each.name) is None for each in fields(self))

    def sql(self) -> str:
        """Return the condition as SQL; "true" for any."""
        named = {name: getattr(self, name) for name in ABOUT}
        terms = [f"{name} = {quote(value)}" for name, value in named.items() if value is not None]
        if self.not_session is not None:
            terms.append(f"session <> {quote(self.not_session)}")
        if self.since_ns is not None:
            terms.append(f"stamp_ns >= {int(self.since_ns)}")
        if self.until_ns is not None:
            terms.append(f"stamp_ns < {int(self.until_ns)}")
        return " AND ".join(terms) or "true"


def quote(value: str) -> str:
    """A text as SQL has it."""
    doubled = value.replace("'", "''")
    return f"'{doubled}'"
