# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Drives for RatSLAM: events in order, messages as they arrive, and courses with known views."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusionslam.evaluation import MapReport, RatSlamRun, judge_map
from fusionslam.geometry.odometry_noise import OdometryConfig, simulate_odometry
from fusionslam.geometry.rigid import fit_rigid
from fusionslam.geometry.trajectory import Trajectory, ground_poses
from fusionslam.pipelines.map_events import RunEvents
from fusionslam.pipelines.maps import RunRecorder
from fusionslam.ratslam import (
    Action,
    ActionKind,
    ExperienceMap,
    GivenView,
    Look,
    Motion,
    OnlineRatSlam,
    RatSlam,
    RatSlamConfig,
    Sighting,
    Step,
)
from fusionslam.ratslam.events import Event
from fusionslam.sensors.messages import Odometry

SECOND = 1_000_000_000
RADIUS, SPEED, PLACES = 2.0, 0.5, 16
DRIFT = OdometryConfig(scale=1.02, rotation_scale=1.03)


def circles(laps: float, radius: float = RADIUS) -> Trajectory:
    """Counter-clockwise from the origin along x."""
    seconds = np.linspace(0, laps * 2 * np.pi * radius / SPEED, round(400 * laps))
    yaw = seconds * SPEED / radius
    return Trajectory(seconds, radius * np.sin(yaw), radius * (1 - np.cos(yaw)), yaw)


def said(stamp_ns: int, pose: Any, **speeds: Any) -> Odometry:
    """Odometry of a base in its own frame."""
    return Odometry(stamp_ns=stamp_ns, frame_id="odom", child_frame_id="base", pose=pose, **speeds)


def odometry(
    way: Trajectory, errors: OdometryConfig = DRIFT, rate_hz: float = 30.0
) -> list[Odometry]:
    track = simulate_odometry(way, errors, rate_hz)
    return [
        said(int(stamp_ns), pose, linear=linear, angular=angular)
        for stamp_ns, pose, linear, angular in zip(*track, strict=True)
    ]


def sightings(way: Trajectory, rate_hz: float = 4.0) -> list[Sighting]:
    """Views by the part of the circle that the robot is in, and where it is against the first."""
    first: list[NDArray[np.float64]] = []
    seen = []
    for second in np.arange(0.1, way.seconds[-1], 1 / rate_hz):
        x, y, yaw = (float(value) for value in way.places(second))
        place = int(yaw / (2 * np.pi) * PLACES) % PLACES
        if place == len(first):
            first.append(np.array([x, y, yaw]))
        dx, dy, turn = np.array([x, y, yaw]) - first[place]
        c, s = np.cos(first[place][2]), np.sin(first[place][2])
        turn = float(np.angle(np.exp(1j * turn)))
        where = (float(c * dx + s * dy), float(c * dy - s * dx))
        seen.append(Sighting(round(second * 1e9), place, turn, where))
    return seen


def in_order(*series: Iterable[Event]) -> list[Event]:
    """By stamp; of equal ones the earlier series first."""
    events = [event for one in series for event in one]
    return sorted(events, key=lambda event: event.stamp_ns)


def grey_image(value: int) -> NDArray[np.uint8]:
    return np.full((100, 120), value, np.uint8)


def circle_events(laps: float = 2.0, errors: OdometryConfig = DRIFT) -> list[Event]:
    way = circles(laps)
    return in_order(odometry(way, errors), sightings(way))


def take(slam: RatSlam, events: Iterable[Event]) -> list[Step]:
    return [slam.step(event) for event in events]


def everything(slam: RatSlam) -> dict[str, Any]:
    """Cells, maps, memory and views of a run, to be compared by ``same``."""
    arrays = {
        f"{name}.{key}": np.array(value)
        for name in ("cells", "map", "alone")
        for key, value in getattr(slam, name).state().items()
    }
    views = b"" if slam.views is None else slam.views.to_bytes()
    return arrays | {"memory": repr(slam.memory), "views": views}


def same(one: dict[str, Any], other: dict[str, Any]) -> bool:
    """True if both are equal to the last bit."""
    return one.keys() == other.keys() and all(_same(one[key], other[key]) for key in one)


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray):
        return (one.dtype, one.shape, one.tobytes()) == (other.dtype, other.shape, other.tobytes())
    return bool(one == other)


@contextmanager
def unchanged(thing: Any) -> Iterator[None]:
    """Cells, a map, a calibration or a run stay what they are, to the last bit."""
    before = _state_of(thing)
    yield
    assert same(_state_of(thing), before)


def _state_of(thing: Any) -> dict[str, Any]:
    return everything(thing) if isinstance(thing, RatSlam) else thing.state()


def errors_of(poses: Sequence[Any] | NDArray[Any], truth: NDArray[np.float64]) -> float:
    """Root mean square distance in metres; both begin at the same pose."""
    apart = np.array(poses)[:, :2] - truth[:, :2]
    return float(np.sqrt((apart**2).sum(axis=1).mean()))


Message = Odometry | Motion | Look


def looks_of(sightings: Iterable[Sighting]) -> list[Look]:
    """As the process that recognised them tells them."""
    known: set[int] = set()
    looks = []
    for one in sightings:
        is_new = one.view_id >= 0 and one.view_id not in known
        known.add(one.view_id)
        values = (one.relative_rotation, one.relative_place, one.reason)
        looks.append(Look(one.stamp_ns, GivenView(one.view_id, is_new, *values)))
    return looks


def replace_sightings(events: Iterable[Event]) -> list[Message]:
    """Sightings as looks, in place."""
    kept = list(events)
    looks = iter(looks_of(one for one in kept if isinstance(one, Sighting)))
    return [next(looks) if isinstance(one, Sighting) else one for one in kept]  # type: ignore[misc]


def order_by_arrival(
    odometry: Sequence[Message],
    looks: Sequence[Message],
    seed: int,
    *,
    lag_s: float = 0.1,
    jitter_s: float = 0.0,
) -> list[Message]:
    """Both streams, each in its order, by when they arrive.

    Args:
        odometry, looks: in the order of stamps.
        seed: of the delays.
        lag_s: how much later than odometry views arrive.
        jitter_s: how much later, at most, than that any message arrives.
    """
    rng = np.random.default_rng(seed)
    due = []
    for stream, lag in ((odometry, 0.0), (looks, lag_s)):
        stamps = np.array([one.stamp_ns for one in stream], np.float64)
        delayed = stamps + 1e9 * (lag + rng.uniform(0, jitter_s, len(stream)))
        due.append(np.maximum.accumulate(delayed))  # TCP keeps the order
    order = np.argsort(np.concatenate(due), kind="stable")
    both = [*odometry, *looks]
    return [both[k] for k in order]


def process_all(online: OnlineRatSlam, messages: Iterable[Any]) -> list[Step]:
    return [step for message in messages for step in online.process(message)]


def process_and_flush(online: OnlineRatSlam, messages: Iterable[Any]) -> list[Step]:
    return process_all(online, messages) + online.flush()


def on_map(slam: RatSlam) -> dict[str, Any]:
    """As ``everything``, but for the source of views."""
    return everything(slam) | {"views": None}


def later(messages: Iterable[Message], seconds: float) -> list[Message]:
    """The same with other stamps."""
    shift = round(seconds * 1e9)
    return [replace(one, stamp_ns=one.stamp_ns + shift) for one in messages]


STEP_M = 0.5
NODES_A_LAP = 120


class Leg(NamedTuple):
    """One step of ``STEP_M`` and a second: where odometry and truth have it, and its place."""

    way: float
    turn: float
    place: int
    truth: tuple[float, float, float]


class Driven(NamedTuple):
    """A map, the true poses of its nodes, and the checks of its loops."""

    graph: ExperienceMap
    truth: Any
    checks: list[Any]

    @property
    def accepted(self) -> int:
        return sum(check.accepted for check in self.checks)

    def rmse(self) -> float:
        """Of its nodes, metres."""
        return rmse(self.graph.nodes, self.truth)


def rmse(poses: Any, truth: Any) -> float:
    """After rigid alignment, metres."""
    aligned = fit_rigid(np.asarray(poses), np.asarray(truth)).apply(np.asarray(poses))
    return float(np.sqrt(((aligned - truth)[:, :2] ** 2).sum(axis=1).mean()))


def laps(count: float, *, scale: float = 1.02, turn: float = 1.01, seed: int = 0) -> Iterator[Leg]:
    """Round a block of 20 m by 10 m, counter-clockwise."""
    random = np.random.default_rng(seed)
    x = y = heading = 0.0
    corners = (40, 60, 100, 120)
    for number in range(round(count * NODES_A_LAP)):
        place = number % NODES_A_LAP
        turned = np.pi / 2 if place in corners or (place == 0 and number) else 0.0
        heading += turned
        x, y = x + STEP_M * np.cos(heading), y + STEP_M * np.sin(heading)
        way = STEP_M * scale * (1 + 0.01 * random.normal())
        yield Leg(way, turned * turn + 0.002 * random.normal(), place, (x, y, heading))


Claim = Callable[[int, dict[int, int], int], int | None]
"""Of the step's number, the nodes by place, and the place: the node that a view says it is."""


def right(number: int, nodes: dict[int, int], place: int) -> int | None:
    """The node that was made there."""
    return nodes.get(place)


def drive(graph: ExperienceMap, legs: Iterator[Leg], claim: Claim = right) -> Driven:
    """Every step ends at a loop, if one is claimed and believed, or at a new node."""
    graph.apply(Action(ActionKind.CREATE_NODE))
    truth, checks, nodes = [(0.0, 0.0, 0.0)], [], dict[int, int]()
    for number, leg in enumerate(legs):
        graph.on_odometry(leg.way, leg.turn, 1.0)
        here, target = graph.current, claim(number, nodes, leg.place)
        if target is not None and target != here:
            loop = Action(ActionKind.CREATE_EDGE, here, target)
            checks.append(graph.check(loop))
            if checks[-1].accepted:
                graph.apply(loop)
                graph.relax()
                continue
        nodes.setdefault(leg.place, len(graph))
        graph.apply(Action(ActionKind.CREATE_NODE, here, len(graph)))
        graph.relax()
        truth.append(leg.truth)
    return Driven(graph, np.array(truth), checks)


def drive_by_odometry(legs: Iterator[Leg]) -> Driven:
    """The same by odometry alone: a map without loops."""
    return drive(ExperienceMap(), legs, lambda *_: None)


def weighted_errors(nodes: Any, links: Any) -> Any:
    """float64 (m, 3): what links say of place and rotation, over their deviations."""
    one, other = nodes[links["source"]], nodes[links["target"]]
    way = one[:, 2] + links["heading"]
    place = other[:, :2] - one[:, :2]
    place = place - links["distance"][:, None] * np.stack([np.cos(way), np.sin(way)], axis=1)
    turn = other[:, 2] - one[:, 2] - links["facing"]
    turn = np.arctan2(np.sin(turn), np.cos(turn))
    return np.column_stack([place / links["sd_m"][:, None], turn / links["sd_rad"]])


COURSE_SPEED, TURN, RATE = 0.5, 0.8, 10
"""m/s along the sides, rad/s at the corners, odometry a second; a view every half second."""
SIDES = (12.0, 6.0)
SAME_VIEW_M = 0.5
"""Metres from a known view within which it is recognised, at the same heading."""


@dataclass(frozen=True)
class LittleCourse:
    """Speeds (n, 2) in m/s and rad/s, true poses (n + 1, 3), and views of a drive."""

    speeds: NDArray[np.float64]
    poses: NDArray[np.float64]
    sightings: list[Sighting]

    @property
    def motions(self) -> list[Motion]:
        """The first one says when the robot begins."""
        rows = np.vstack([self.speeds[:1], self.speeds]).tolist()
        return [Motion(i * 10**9 // RATE, v, w) for i, (v, w) in enumerate(rows)]

    def add_drift(self, times: float = 1.0) -> "LittleCourse":
        """2 % too far, turns 1 % too wide, or so many times that."""
        return replace(self, speeds=self.speeds * (1 + 0.02 * times, 1 + 0.01 * times))

    def mislead(self, share: float, seed: int = 0) -> "LittleCourse":
        """Some known views are taken for others, at least twice the radius away."""
        luck = np.random.default_rng(seed)
        told: list[Sighting] = []
        first: list[NDArray[np.float64]] = []
        for sighting in self.sightings:
            here = self.pose_at(sighting)[:2]
            if sighting.view_id == len(first):
                first.append(here)
                told.append(sighting)
                continue
            far = np.flatnonzero(np.linalg.norm(np.array(first) - here, axis=1) > 2)
            wrong = luck.random() < share and far.size > 0
            told.append(Sighting(sighting.stamp_ns, int(luck.choice(far))) if wrong else sighting)
        return replace(self, sightings=told)

    def pose_at(self, sighting: Sighting) -> NDArray[np.float64]:
        return np.asarray(self.poses[sighting.stamp_ns * RATE // 10**9])

    def messages(self, start: int, end: int, shift_ns: int = 0) -> list[Message]:
        """Views, and odometry that drifts and begins at its own origin, of some of the steps."""
        looks = looks_of(self.sightings)
        looks = [one for one in looks if start <= one.stamp_ns * RATE // SECOND < end]
        poses = np.zeros((end - start + 1, 3))
        for i, (v, w) in enumerate(self.add_drift().speeds[start:end]):
            heading = poses[i, 2] + w / RATE
            poses[i + 1] = (*(poses[i, :2] + v / RATE * _direction(heading)), heading)
        moves = [
            said(number * SECOND // RATE, pose)
            for number, pose in enumerate(ground_poses(*poses.T), start)
        ]
        both: list[Message] = [*moves, *looks]
        return later(sorted(both, key=lambda one: one.stamp_ns), shift_ns / SECOND)

    def run(self, config: RatSlamConfig) -> RatSlamRun:
        seconds = np.arange(len(self.poses)) / RATE
        x, y, yaw = self.poses.T
        stamps = np.array([sighting.stamp_ns for sighting in self.sightings])
        item = self.sightings.__getitem__
        truth = Trajectory(seconds, x, y, yaw)
        events = RunEvents("laps", "wheels", self.motions, stamps, item, truth)
        recorder = RunRecorder(RatSlam(config), events)
        for event in events:
            recorder.step(getattr(event, "item", event))
        return recorder.record()

    def judge(self, config: RatSlamConfig) -> MapReport:
        return judge_map(self.run(config))


def lap_course(count: int = 3, *, measured: bool = True) -> LittleCourse:
    """``measured``: views tell where the robot is in their frame; else no more than their id."""
    speeds = np.array([speed for _ in range(count) for side in SIDES * 2 for speed in _side(side)])
    poses = np.zeros((len(speeds) + 1, 3))
    for i, (v, w) in enumerate(speeds):
        heading = poses[i, 2] + w / RATE
        poses[i + 1] = (*(poses[i, :2] + v / RATE * _direction(heading)), heading)
    return LittleCourse(speeds, poses, _sightings(poses, measured))


def _side(metres: float) -> list[tuple[float, float]]:
    turn = round(np.pi / 2 / TURN * RATE)
    straight = [(COURSE_SPEED, 0.0)] * round(metres / COURSE_SPEED * RATE)
    return straight + [(0.0, np.pi / 2 / turn * RATE)] * turn


def _sightings(poses: NDArray[np.float64], measured: bool) -> list[Sighting]:
    known: list[NDArray[np.float64]] = []
    found = []
    for i in range(0, len(poses), RATE // 2):
        nearest, place = _nearest(known, poses[i])
        if nearest == len(known):
            known.append(poses[i])
        x, y, turn = place if measured else (0.0, 0.0, 0.0)
        found.append(Sighting(i * 10**9 // RATE, nearest, turn, (x, y)))
    return found


def _nearest(
    known: list[NDArray[np.float64]], pose: NDArray[np.float64]
) -> tuple[int, tuple[float, float, float]]:
    """The nearest known view and the pose in its frame; a new one if none is near."""
    best, found = SAME_VIEW_M, (len(known), (0.0, 0.0, 0.0))
    for number, view in enumerate(known):
        apart, turn = (
            pose[:2] - view[:2],
            np.remainder(pose[2] - view[2] + np.pi, 2 * np.pi) - np.pi,
        )
        if np.hypot(*apart) < best and abs(turn) < 0.3:
            forward = _direction(view[2])
            left = np.array([-forward[1], forward[0]])
            best = float(np.hypot(*apart))
            found = number, (float(apart @ forward), float(apart @ left), float(turn))
    return found


def _direction(heading: float) -> NDArray[np.float64]:
    return np.array([np.cos(heading), np.sin(heading)])
