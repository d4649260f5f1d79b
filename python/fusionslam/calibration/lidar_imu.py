# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Where an IMU is in the frame of a LiDAR, and how late its stamps are, by how both move.

Turns are compared with integrated turn rates from the first scan of a piece on, positions with
doubly integrated accelerations over about a second, in which positions and velocities at the
beginning are eliminated (Forster et al., "On-Manifold Preintegration", T-RO 2017, eqs. 33 to 38).
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray
from scipy.linalg import block_diag, null_space
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation, Slerp
from scipy.stats import t as student

from fusionslam.base.arrays import Floats, Matrix
from fusionslam.calibration.estimate import Estimate
from fusionslam.calibration.scan_path import PathPiece, ScanPath, Turning
from fusionslam.errors import DataError
from fusionslam.sensors.messages import NANOSECONDS, Imu

LATEST_S = 1.0
"""Of the IMU's stamps: further offsets are mistakes, not delays."""
_GRID_S = 0.01
_WINDOW = 15
"""Scans, over which accelerations are integrated."""
_CLUSTER = 25
"""Scans whose errors may be alike, one after the other."""
_DRIFT = 4
"""Degree of the polynomials by which a path of 10 s may bend: slower than the turns that tell."""
_FINEST = 1e-4
"""Radians: no path is better."""
_CAUTION = 2.0
"""Intervals of turns are wider by this: registered scans mix roll with pitch, alike in all pieces,
which their spread does not show (measured on made drives, docs/guides/calibration.md)."""
_WIDEST_DEG, _WIDEST_M, _WIDEST_MS = 0.5, 0.05, 10.0
"""Half widths of intervals beyond which nothing is said."""
_MISFIT_DEG = 0.8
"""Root mean square by which a path turns otherwise than the gyroscope, slow drift apart, beyond
which scans were registered wrongly: good paths are at 0.02 to 0.6."""
_STEP_RAD = 0.05
_LOOSE_DEG = 2.0
"""Half width of a turn beyond which the others, too, and the place cannot be told: they mix."""
_FASTEST_RAD_S = 40.0
_IN_G = 2.0
_WIDEST_GAP_S = 0.05
_AXES = "xyz"


class ImuRows(NamedTuple):
    """What an IMU said at N times.

    Attributes:
        seconds: float64 (N), increasing, since the path's begin.
        angular: float64 (N, 3), rad/s.
        linear: float64 (N, 3), m/s^2.
    """

    seconds: Floats
    angular: Floats
    linear: Floats


@dataclass(frozen=True, eq=False)
class ImuCalibration:
    """Where the IMU is.

    Attributes:
        lidar_from_imu: float64 (4, 4), the best guess: parts that cannot be said are as stated.
        estimates: turn of the stated pose about the LiDAR's axes, place, and delay.
        unit: factor that makes m/s^2 of its accelerations, 1 unless they are in g.
        turning: how the LiDAR turned, by the gyroscope; None where its axes are not known.
        turn, place, delay: float64 (3, 3), (3,) and seconds, of the best fit, said or not.
    """

    lidar_from_imu: Matrix
    estimates: list[Estimate]
    unit: float
    turning: Turning | None
    turn: Matrix
    place: Floats
    delay: float


class Fit(NamedTuple):
    """Values (P), and half widths of their 95 % intervals."""

    values: Floats
    half_widths: Floats


def read_imu(messages: Iterable[Imu], path: ScanPath) -> ImuRows:
    """Collect messages, by stamp.

    Raises:
        DataError: there are none (code "no-imu"), one is not finite ("not-finite"), rates are in
            degrees ("imu-unit"), or they are of another time than the scans ("clock").
    """
    found = [(imu.stamp_ns, *imu.angular, *imu.linear) for imu in messages]
    if not found:
        raise DataError("there are no messages of an IMU", code="no-imu")
    stamps, rows = np.array([row[0] for row in found]), np.array([row[1:] for row in found], float)
    stamps, first = np.unique(stamps, return_index=True)
    rows = rows[first]
    if not np.isfinite(rows).all():
        bad = int(stamps[~np.isfinite(rows).all(axis=1)][0])
        raise DataError(
            f"the IMU's message at {bad} ns is not finite", code="not-finite", fields=(str(bad),)
        )
    fastest = float(np.abs(rows[:, :3]).max())
    if fastest > _FASTEST_RAD_S:
        raise DataError(
            f"the IMU turns by {fastest:.3g} rad/s, expected at most {_FASTEST_RAD_S:g}: are its "
            "rates in degrees?",
            code="imu-unit",
            fields=("angular_velocity", f"{fastest:.3g}"),
        )
    seconds = (stamps - path.begin_ns) / NANOSECONDS
    begin, end = path.pieces[0].seconds[0], path.pieces[-1].seconds[-1]
    if seconds[-1] < begin or seconds[0] > end:
        raise DataError(
            f"the IMU's stamps are from {seconds[0]:.3f} to {seconds[-1]:.3f} s after the first "
            f"scan, the scans from {begin:.3f} to {end:.3f}: their clocks are apart",
            code="clock",
            fields=(f"{seconds[0]:.3f}", f"{begin:.3f}"),
        )
    return ImuRows(seconds, rows[:, :3], rows[:, 3:])


def calibrate_imu(
    path: ScanPath, imu: ImuRows, stated: Matrix | None, before: ImuCalibration | None = None
) -> ImuCalibration:
    """Estimate where an IMU is.

    Args:
        path: of the LiDAR.
        imu: its messages.
        stated: float64 (4, 4), lidar_from_imu as the recording says; None if it does not.
        before: what the path began with, which it may still lean to: intervals allow for as much
            as the last change.

    Raises:
        DataError: accelerations do not show gravity (code "imu-unit"), turns do not fit at any
            delay up to a second ("clock"), rates are too far apart ("gap"), or all pieces of the
            path turn otherwise than the gyroscope ("path").
    """
    unit = _unit(imu.linear)
    delay, turn = _first_guess(path, imu)
    covered = [_cover(piece, imu) for piece in path.pieces]
    pieces = [piece for piece in covered if piece is not None]
    if not pieces:
        raise DataError("the IMU says too little while scans were taken", code="gap")
    bias = np.zeros(3)
    # Each time anew where the last one ended. The bias is that of a path without drift; then it
    # stays, and the path may drift. The last time only pieces count that turn as the gyroscope.
    drifts = (0, 0, 0, _DRIFT, _DRIFT, _DRIFT)
    for number, drift in enumerate(drifts, start=1):
        fit, starts, misfits = _fit_turns(pieces, imu, turn, bias, delay, drift)
        # Steps about an axis that nothing tells would be wild, and turn the others with them.
        step = np.clip(fit.values[:3], -_STEP_RAD, _STEP_RAD)
        turn = Rotation.from_rotvec(step).as_matrix() @ turn
        delay += float(fit.values[3])
        bias = bias + (fit.values[4:7] if not drift else 0)
        if number == len(drifts) - 1:
            pieces = _trusted(pieces, misfits)
    places = _fit_places(pieces, imu._replace(linear=imu.linear * unit), turn, bias, delay, starts)
    widths, place_widths = fit.half_widths[:4], places.half_widths[:3]
    if before is not None:
        change = Rotation.from_matrix(turn @ before.turn.T).as_rotvec()
        widths = np.hypot(widths, [*change, delay - before.delay])
        place_widths = np.hypot(place_widths, places.values[:3] - before.place)
    widths[:3] *= _CAUTION
    pose = np.eye(4) if stated is None else stated.copy()
    widths = np.r_[np.degrees(widths[:3]), 1000 * widths[3]]
    unknown = ~(widths[:3] <= _LOOSE_DEG)
    told = None if unknown.any() else _turning(imu, turn, bias, delay)
    found = Rotation.from_matrix(turn @ pose[:3, :3].T).as_rotvec(degrees=True)
    spread = _spread(pieces)
    turns, at = [], []
    for row, letter in enumerate(_AXES):
        others = [other for other in range(3) if other != row]
        about = " or ".join(_AXES[other] for other in others)
        most = float(spread[others].max())
        drive = f"the drive turns by {most:.2g} degrees (standard deviation) about {about}; some"
        lacking = f"{drive} {most * widths[row] / _WIDEST_DEG:.2g} are needed"
        now = None if stated is None else 0.0
        width, name = widths[row], f"IMU turned about {letter}"
        if unknown.any() and not unknown[row]:
            width, lacking = np.inf, "its turns about all axes are needed together"
        turns.append(_state(name, found[row], width, "deg", _WIDEST_DEG, lacking, now))
        lacking = f"{drive} {most * place_widths[row] / _WIDEST_M:.2g} within a second are needed"
        width, name = place_widths[row], f"IMU at {letter}"
        if unknown.any():
            width, lacking = np.inf, "its turns about all axes are needed first"
        now = None if stated is None else float(stated[row, 3])
        at.append(_state(name, places.values[row], width, "m", _WIDEST_M, lacking, now))
        if at[-1].value is not None:
            pose[row, 3] = places.values[row]
    if all(each.value is not None for each in turns):
        pose[:3, :3] = turn
    turning = float(np.linalg.norm(spread))
    lacking = (
        f"the drive turns by {turning:.2g} degrees (standard deviation); some "
        f"{turning * widths[3] / _WIDEST_MS:.2g} are needed"
    )
    late = _state("IMU late by", 1000 * delay, widths[3], "ms", _WIDEST_MS, lacking, 0.0)
    return ImuCalibration(pose, [*turns, *at, late], unit, told, turn, places.values[:3], delay)


def _trusted(pieces: list[PathPiece], misfits: Floats) -> list[PathPiece]:
    """Those that turn as the gyroscope does."""
    trusted = [
        piece for piece, misfit in zip(pieces, misfits, strict=True) if misfit <= _MISFIT_DEG
    ]
    if not trusted:
        raise DataError(
            "the path by scans turns otherwise than the gyroscope, by "
            f"{misfits.min():.2g} degrees (root mean square), expected at most {_MISFIT_DEG:g}: "
            "move slower, near walls and furniture; or the axes of the IMU are left-handed",
            code="path",
            fields=(f"{misfits.min():.2g}",),
        )
    return trusted


def _turning(imu: ImuRows, turn: Matrix, bias: Floats, delay: float) -> Turning:
    rates = (imu.angular[1:] + imu.angular[:-1]) / 2 - bias
    turns = _add_up(Rotation.from_rotvec(rates * np.diff(imu.seconds)[:, None]))
    seconds = imu.seconds - delay
    known = Slerp(seconds, Rotation.from_matrix(turn @ turns @ turn.T))
    return lambda at: known(np.clip(at, seconds[0], seconds[-1]))


def _add_up(steps: Rotation) -> Floats:
    """Turns (N + 1, 3, 3) from the first time on, by those of N steps."""
    turns = [np.eye(3)]
    for step in steps.as_matrix():
        turns.append(turns[-1] @ step)
    return np.array(turns)


def _state(
    name: str, value: float, width: float, unit: str, widest: float, lacking: str, now: float | None
) -> Estimate:
    if not np.isfinite(width) or width > widest:
        return Estimate(name, None, unit, None, lacking, now)
    return Estimate(name, float(value), unit, float(width), None, now)


def _unit(linear: Floats) -> float:
    size = float(np.median(np.linalg.norm(linear, axis=1)))
    if 0.5 < size < _IN_G:
        return 9.80665
    if not 7.0 < size < 13.0:
        raise DataError(
            f"the IMU's accelerations are {size:.3g} in the median, expected gravity, about 9.8 "
            "m/s^2",
            code="imu-unit",
            fields=("linear_acceleration", f"{size:.3g}"),
        )
    return 1.0


def _first_guess(path: ScanPath, imu: ImuRows) -> tuple[float, Matrix]:
    """Delay of the IMU in seconds and lidar_from_imu turn, by mean rates between scans."""
    middles, gaps, rates = [], [], []
    for piece in path.pieces:
        turns = Rotation.from_matrix(piece.poses[:, :3, :3])
        gap = np.diff(piece.seconds)
        rates.append((turns[:-1].inv() * turns[1:]).as_rotvec() / gap[:, None])
        middles.append(piece.seconds[:-1])
        gaps.append(gap)
    begin, gap, rate = (np.concatenate(rows) for rows in (middles, gaps, rates))
    steps = np.diff(imu.seconds)[:, None]
    summed = np.r_[
        np.zeros((1, 3)), np.cumsum((imu.angular[1:] + imu.angular[:-1]) / 2 * steps, axis=0)
    ]

    def mean_rates(delay: float) -> Floats:
        ends = (
            np.stack([np.interp(at + delay, imu.seconds, axis) for axis in summed.T], axis=1)
            for at in (begin, begin + gap)
        )
        first, last = ends
        return np.asarray((last - first) / gap[:, None])

    delays = np.arange(-LATEST_S - 0.5, LATEST_S + 0.5 + _GRID_S / 2, _GRID_S)
    sizes = np.linalg.norm(rate, axis=1)
    fits = []
    for delay in delays:
        others = np.linalg.norm(mean_rates(float(delay)), axis=1)
        both = np.corrcoef(sizes, others)[0, 1] if others.std() > 0 < sizes.std() else 0.0
        fits.append(both)
    best = float(delays[int(np.argmax(fits))])
    moves = float(np.degrees(sizes.std())) > 0.5
    if moves and max(fits) > 0.5 and abs(best) > LATEST_S:
        raise DataError(
            f"turns of the IMU fit those of the scans best if it is {best:+.2f} s late, expected "
            f"at most {LATEST_S:g} s: are the clocks apart?",
            code="clock",
            fields=(f"{best:.2f}",),
        )
    if max(fits) < 0.5:
        best = 0.0  # too little turns to tell: the intervals will say so
    turn, _ = Rotation.align_vectors(rate, mean_rates(best))
    return best, turn.as_matrix()


def _cover(piece: PathPiece, imu: ImuRows) -> PathPiece | None:
    """The scans of a piece while the IMU speaks without gaps, whatever the delay; or None."""
    gaps = np.flatnonzero(np.diff(imu.seconds) > _WIDEST_GAP_S)
    begins = np.r_[imu.seconds[0], imu.seconds[gaps + 1]]
    ends = np.r_[imu.seconds[gaps], imu.seconds[-1]]
    longest: NDArray[np.intp] = np.zeros(0, np.intp)
    for begin, end in zip(begins, ends, strict=True):
        inside = np.flatnonzero(
            (piece.seconds > begin + LATEST_S) & (piece.seconds < end - LATEST_S)
        )
        longest = inside if len(inside) > len(longest) else longest
    if len(longest) < 2 * _WINDOW:
        return None
    return PathPiece(piece.seconds[longest], piece.poses[longest])


class _Integral(NamedTuple):
    """What rates and accelerations add up to at the K scans of a piece, from its first one on.

    Attributes:
        turns: float64 (K, 3, 3), first_from_then, of the IMU's axes.
        sums: float64 (K, 3, 3), the integral of the turns.
        rates: float64 (K, 3), rad/s.
        places: float64 (K, 3), of accelerations, twice integrated, in the first axes.
        twice: float64 (K, 3, 3), the turns, twice integrated.
    """

    turns: Floats
    sums: Floats
    rates: Floats
    places: Floats
    twice: Floats


def _integrate(piece: PathPiece, imu: ImuRows, bias: Floats, delay: float) -> _Integral:
    wanted = piece.seconds + delay
    inside = imu.seconds[(imu.seconds > wanted[0]) & (imu.seconds < wanted[-1])]
    every = np.union1d(wanted, inside)
    rates, felt = (
        np.stack([np.interp(every, imu.seconds, axis) for axis in rows.T], axis=1)
        for rows in (imu.angular, imu.linear)
    )
    rates = rates - bias
    gaps = np.diff(every)
    turns = _add_up(Rotation.from_rotvec((rates[:-1] + rates[1:]) / 2 * gaps[:, None]))
    gap = gaps[:, None, None]

    def summed(values: Floats) -> Floats:
        return np.asarray(np.r_[0 * values[:1], np.cumsum((values[1:] + values[:-1]) / 2 * gap, 0)])

    forces = np.einsum("nij,nj->ni", turns, felt)[:, :, None]
    sums = summed(turns)
    rows = np.searchsorted(every, wanted)
    return _Integral(
        turns[rows],
        sums[rows],
        rates[rows],
        summed(summed(forces))[rows, :, 0],
        summed(sums)[rows],
    )


def _fit_turns(
    pieces: list[PathPiece], imu: ImuRows, turn: Matrix, bias: Floats, delay: float, drift: int
) -> tuple[Fit, list[Matrix], Floats]:
    """Corrections of turn (3, about the LiDAR's axes), delay, and bias (3) unless the path drifts.

    A measured turn M of scan k from the first one is exp(c) P, P = R G R^T, with the integrated G:
    a small turn of R by a adds (1 - P) a, one of the bias by b takes off R (int G) b, and a later
    delay by d adds R (G w_k - w_0) d. The path's drift c is a polynomial of this degree.

    Returns:
        The fit, the turn of each piece at its first scan, and its misfit in degrees.
    """
    blocks, residuals, labels, own, clusters = [], [], [], [], 0
    for piece in pieces:
        whole = _integrate(piece, imu, bias, delay)
        predicted = turn @ whole.turns @ turn.T
        measured = piece.poses[0, :3, :3].T @ piece.poses[:, :3, :3]
        off = Rotation.from_matrix(measured @ predicted.transpose(0, 2, 1))
        moved = np.einsum("nij,nj->ni", turn @ whole.turns, whole.rates) - turn @ whole.rates[0]
        columns = [np.eye(3) - predicted, moved[:, :, None]]
        if not drift:
            columns.append(-turn @ whole.sums)
        blocks.append(np.concatenate(columns, axis=2).reshape(3 * len(off), -1))
        since = np.interp(piece.seconds, piece.seconds[[0, -1]], [-1, 1])
        own.append(np.kron(legvander(since, drift), np.eye(3)))
        residuals.append(off.as_rotvec().ravel())
        labels.append(np.repeat(np.arange(len(piece.seconds)) // _CLUSTER + clusters, 3))
        clusters = labels[-1].max() + 1
    shared = np.concatenate(blocks)
    model, found = np.c_[shared, block_diag(*own)], np.concatenate(residuals)
    fit = solve(model, found, np.concatenate(labels))
    # Odometry may do badly in one piece and well in another one.
    sizes = [len(residual) for residual in residuals]
    rest = np.split((found - model @ fit.values) ** 2, np.cumsum(sizes)[:-1])
    misfits = np.sqrt([3 * each.mean() for each in rest])
    weights = np.repeat(1 / np.maximum(misfits, _FINEST), sizes)
    fit = solve(model * weights[:, None], found * weights, np.concatenate(labels))
    starts, column = [], shared.shape[1]
    for polynomial in own:
        begin = polynomial[:3] @ fit.values[column : column + polynomial.shape[1]]
        starts.append(Rotation.from_rotvec(begin).as_matrix())
        column += polynomial.shape[1]
    return fit, starts, np.degrees(misfits)


def _fit_places(
    pieces: list[PathPiece],
    imu: ImuRows,
    turn: Matrix,
    bias: Floats,
    delay: float,
    starts: list[Matrix],
) -> Fit:
    """Place of the IMU (3, in the LiDAR's frame), bias of accelerations (3), gravity of pieces."""
    rows: list[Floats] = []
    residuals: list[Floats] = []
    for number, (piece, start) in enumerate(zip(pieces, starts, strict=True)):
        first = piece.poses[0, :3, :3] @ start @ turn  # piece_from_imu at its first scan
        turned = _integrate(piece, imu, bias, delay).turns
        for begin in range(0, len(piece.seconds) - _WINDOW + 1, _WINDOW):
            part = PathPiece(
                piece.seconds[begin : begin + _WINDOW], piece.poses[begin : begin + _WINDOW]
            )
            axes = first @ turned[begin]
            whole = _integrate(part, imu, bias, delay)
            since = part.seconds - part.seconds[0]
            free = null_space(np.stack([np.ones(_WINDOW), since]))  # eliminates place and velocity
            lever = axes @ whole.turns @ turn.T
            gravity = np.zeros((_WINDOW, 3, 3 * len(pieces)))
            gravity[:, :, 3 * number : 3 * number + 3] = since[:, None, None] ** 2 / 2 * np.eye(3)
            known = part.poses[:, :3, 3] - whole.places @ axes.T
            model = np.concatenate([-lever, -axes @ whole.twice, gravity], axis=2)
            rows.append(np.einsum("kf,kip->fip", free, model).reshape(-1, model.shape[2]))
            residuals.append((free.T @ known).ravel())
    labels = np.repeat(np.arange(len(rows)), [len(each) for each in rows])
    return solve(np.concatenate(rows), np.concatenate(residuals), labels)


def solve(model: Floats, found: Floats, labels: NDArray[np.intp]) -> Fit:
    """Robust least squares, with intervals that allow for errors that are alike within labels.

    Half widths are infinite where columns cannot be told apart. They are by the sandwich of
    clusters (Liang and Zeger 1986), or if that is wider by independent errors.
    """
    scale = np.linalg.norm(model, axis=0)
    scale[scale == 0] = 1.0
    scaled = model / scale
    guess = np.linalg.lstsq(scaled, found, rcond=1e-9)[0]
    spread = 1.4826 * float(np.median(np.abs(found - scaled @ guess))) or 1e-12
    fit = least_squares(
        lambda x: (scaled @ x - found) / spread,
        guess,
        jac=lambda x: scaled / spread,
        loss="soft_l1",
        f_scale=2.0,
    )
    rest = (scaled @ fit.x - found) / spread
    weights = 1 / np.sqrt(1 + (rest / 2) ** 2)
    information = (scaled * weights[:, None]).T @ scaled / spread**2
    values, vectors = np.linalg.eigh(information)
    inverted = (vectors / np.maximum(values, 1e-12 * values[-1])) @ vectors.T
    gradients = scaled / spread * (weights * rest)[:, None]
    count = int(labels.max()) + 1
    sums = np.zeros((count, scaled.shape[1]))
    np.add.at(sums, labels, gradients)
    clustered = inverted @ (sums.T @ sums) @ inverted * count / (count - 1)
    independent = inverted * float((weights * rest**2).mean())
    variances = np.maximum(np.diag(clustered), np.diag(independent))
    half_widths = student.ppf(0.975, count - 1) * np.sqrt(variances) / scale
    return Fit(fit.x / scale, half_widths)


def _spread(pieces: list[PathPiece]) -> Floats:
    """Standard deviation of the turns within pieces about the LiDAR's axes, degrees (3)."""
    turns = [
        Rotation.from_matrix(piece.poses[0, :3, :3].T @ piece.poses[:, :3, :3]).as_rotvec(
            degrees=True
        )
        for piece in pieces
    ]
    return np.asarray(np.sqrt(np.mean([each.var(axis=0) for each in turns], axis=0)))
