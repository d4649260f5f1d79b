# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``ViewMatcher``: recognises places, one ``process`` call per scan (Stastny 2022, 4.4)."""

import io
import random
import threading
from dataclasses import asdict, astuple, replace
from functools import partial
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.archive import check_types, join_parts, load_archive, part_of, save_archive
from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Matrix
from fusionslam.base.files import PathLike
from fusionslam.base.texts import counted
from fusionslam.config import merged
from fusionslam.descriptors import DescriptorConfig
from fusionslam.errors import ConfigError, DataError
from fusionslam.fusion import ROBOT_FUSION, FusionConfig, fuse
from fusionslam.sensors.frame import Frame
from fusionslam.views.alignment_comparison import AlignmentComparison
from fusionslam.views.comparison import Candidate, Comparison, Item, View
from fusionslam.views.match import NO_VIEW, Revision, Slot, ViewMatch, ViewStats
from fusionslam.views.place_filter import Belief, Location, PlaceFilter
from fusionslam.views.place_hypotheses import agree
from fusionslam.views.recognisers import (
    ViewMatcherConfig,
    build_comparison,
    complete_config,
)

FORMAT = "fusionslam.view_matcher.1"

_ABSENCE = 0.1
"""Scans without a view, as a share of the stored views, from which it was absent: a robot that
stands still uses one view again and again, which does not tell that it will come back."""


@checked
class ViewMatcher:
    """Gives each scan the id of the place it shows, or a new id.

    Thread-safe: scans are matched one at a time, in the order in which ``process`` reaches them;
    their views are built in parallel. It can be sent to another process, stored views included.

    Args:
        config: what is compared and stored.
        fusion: how frames are fused into clouds; by default in the robot's frame, without ground.
        descriptors: how clouds are described, if the method is a descriptor.
        comparison: replaces the configured method, for example by one with a second stage.

    Attributes:
        config: names the method and the second stage that it uses, even if the preset decided.

    Raises:
        ConfigError: a value out of range.
    """

    def __init__(
        self,
        config: ViewMatcherConfig | None = None,
        *,
        fusion: FusionConfig | None = None,
        descriptors: DescriptorConfig | None = None,
        comparison: Comparison | None = None,
    ) -> None:
        self.config = config or ViewMatcherConfig()
        self.fusion_config = fusion or ROBOT_FUSION
        self.descriptor_config = descriptors or DescriptorConfig()
        self._is_custom = comparison is not None
        if comparison is None:  # not "or": an empty comparison is falsy
            self.config = complete_config(self.config)
            comparison = build_comparison(self.config, self.descriptor_config)
        self.comparison = comparison
        given = self.config.threshold
        self.threshold = self.comparison.default_threshold if given is None else given
        self._slots: list[Slot] = []
        self._stats = ViewStats()
        self._lock = threading.RLock()
        self._filter: PlaceFilter | None = None

    def __reduce__(self) -> Any:
        stream = io.BytesIO()
        self.save(stream)
        stream.seek(0)
        given = self.comparison if self._is_custom else None
        return partial(type(self).load, comparison=given), (stream,)

    def __repr__(self) -> str:
        stored, seen = counted(len(self), "stored view"), counted(self._stats.processed, "scan")
        return f"<ViewMatcher {self.comparison.kind}: {stored}, {seen}>"

    @property
    def stats(self) -> ViewStats:
        """A copy of the counts of what has been done so far."""
        with self._lock:
            return replace(self._stats, stored=len(self))

    def __len__(self) -> int:
        """Number of views stored now."""
        return len(self._slots)

    @property
    def can_follow_odometry(self) -> bool:
        """Whether ``process`` takes odometry: by alignment, from the first stored view on."""
        has_begun = self._filter is not None or not self._slots
        return self.comparison.kind == AlignmentComparison.kind and has_begun

    @property
    def odometry_factors(self) -> tuple[float, float]:
        """What odometry's distances and turns are multiplied by, as matches have shown so far."""
        with self._lock:
            return (1.0, 1.0) if self._filter is None else self._filter.factors

    def view(self, item: Frame | Item | View) -> View:
        """The view of a frame, a cloud, or data computed from one.

        Raises:
            DataError: NaN, no colours, or a frame that cannot be fused. ShapeError: the comparison
                does not accept the item.
        """
        if isinstance(item, View):
            return item
        return self.comparison.view(
            fuse(item, self.fusion_config) if isinstance(item, Frame) else item
        )

    def process(self, item: Frame | Item | View, *, odometry: Matrix | None = None) -> ViewMatch:
        """Recognise the place that a scan shows; stores the scan if it is the first of its place.

        Args:
            item: the scan.
            odometry: float64 (4, 4), odom_from_robot, any frame. A matcher that has got odometry
                weighs the stored views by it, and takes a scan without as one after which the
                robot may be anywhere. It needs alignment, and odometry from the first scan on.

        Raises:
            DataError, ShapeError: as ``view``, or of odometry; ConfigError: odometry, but the
                method does not tell poses, or scans without came first (code "no-filter").
                Nothing is counted or stored.
        """
        view = self.view(item)
        with self._lock:
            places = self._filter
            if odometry is not None and places is None:
                places = self._new_filter()
            problem = "" if places is None else places.move(odometry)
            self._filter = places
            match = self._match(view)
            if places is not None:
                match = self._revise(match, places)
            if problem:
                match = replace(match, reason=f"{match.reason}; {problem}")
            self._stats.processed += 1
            self._stats.single += view.objects == 1
        return match

    def _new_filter(self) -> PlaceFilter:
        if not self.can_follow_odometry:
            found = f"views by {self.comparison.kind}"
            if self._slots:
                found = f"{counted(len(self), 'stored view')} without odometry"
            raise ConfigError(
                f"odometry, but {found}: expected alignment, and odometry from the first scan on",
                code="no-filter",
                fields=("odometry",),
            )
        return PlaceFilter(self.config.places)

    def _match(self, view: View) -> ViewMatch:
        if view.objects < self.config.min_objects:
            self._stats.nothing += 1
            least = self.config.min_objects
            reason = f"nothing to recognise: {view.objects} objects, min_objects is {least}"
            return ViewMatch(NO_VIEW, 0.0, False, reason, False)
        if self._filter is not None:
            return self._match_place(view, self._filter)
        best = next(iter(self.comparison.compare(view, 1)), None) if self._slots else None
        if best is not None and not best.rejected and best.similarity >= self.threshold:
            return self._match_view(view, best)
        return self._start_place(view, best)

    def _match_place(self, view: View, places: PlaceFilter) -> ViewMatch:
        """Recognise the place by what the scan and odometry say together."""
        candidates = self._find_candidates(view, places)
        belief = places.weigh(candidates, self.threshold)
        # Before a view is dropped to make room, after which slots are others.
        by_place: dict[int, float] = {}
        for slot, share in belief.shares:
            place = self._slots[slot].id
            by_place[place] = by_place.get(place, 0.0) + share
        firsts = self._first_slots()
        if belief.best is not None and belief.known >= self.threshold:
            places.arrive(belief.best, candidates)
            best = replace(belief.best, similarity=belief.known)
            older = places.locate(firsts, self.config.places.older)
            if older is not None and self._slots[older.slot].id < self._slots[best.slot].id:
                # Only as an alignment measured it: the filter's own map may still be bent.
                seen = next((one for one in candidates if one.slot == older.slot), None)
                pose = None if seen is None else seen.relative_pose
                if pose is not None and agree(np.array([pose]), older.pose)[0]:
                    best = replace(best, slot=older.slot, relative_pose=pose)
            match = self._match_view(view, best)
        elif (here := places.locate(firsts, self.threshold)) is not None:
            match = self._match_by_odometry(here)
        elif belief.new >= 0.5 or belief.best is None:
            match = self._start_place(view, None)
            reason = f"new view {match.id}: probability {belief.new:.4g}"
            match = replace(match, similarity=belief.new, reason=reason)
        else:
            match = self._hold_back(belief, places)
        shares = tuple(sorted(by_place.items(), key=lambda item: -item[1]))
        return replace(match, candidates=shares, look_alikes=belief.look_alikes)

    def _find_candidates(self, view: View, places: PlaceFilter) -> list[Candidate]:
        if not self._slots:
            return []
        config = self.config.places
        most = config.lost_candidates if places.is_lost else config.candidates
        if isinstance(self.comparison, AlignmentComparison):
            return self.comparison.compare_near(view, places.find_near(), most)
        return self.comparison.compare(view, most)

    def _first_slots(self) -> list[int]:
        """The first stored view of each place, oldest first."""
        firsts: dict[int, int] = {}
        for number, slot in enumerate(self._slots):
            firsts.setdefault(slot.id, number)
        return [*firsts.values()]

    def _match_by_odometry(self, here: Location) -> ViewMatch:
        """The robot is at a place that the scan does not show, as if something stood before it."""
        slot = self._slots[here.slot]
        slot.use(self._stats.processed)
        self._stats.matched += 1
        self._stats.by_odometry += 1
        return ViewMatch(
            id=slot.id,
            similarity=here.probability,
            is_new=False,
            reason=f"matched view {slot.id}: odometry has the robot there, not the scan",
            stored=False,
            matched=slot.number,
            relative_pose=here.pose,
            by_odometry=True,
        )

    def _hold_back(self, belief: Belief, places: PlaceFilter) -> ViewMatch:
        self._stats.ambiguous += 1
        places.pass_by()
        why = "the robot is lost" if places.is_lost else f"none has {self.threshold:.4g}"
        said = counted(len({self._slots[slot].id for slot, _ in belief.shares}), "place")
        reason = f"ambiguous: {said} may be right, {why}"
        match = ViewMatch(NO_VIEW, belief.known, False, reason, False, is_ambiguous=True)
        best = belief.best
        if best is None or not places.is_lost or best.similarity < self.threshold:
            return match
        slot = self._slots[best.slot]
        return replace(match, guess=slot.id, matched=slot.number, relative_pose=best.relative_pose)

    def _revise(self, match: ViewMatch, places: PlaceFilter) -> ViewMatch:
        """Remember an answer, and revise those before it."""
        revised: list[Revision] = []
        if match.id != NO_VIEW and not (match.is_new or match.by_odometry) and places.may_revise:
            firsts = self._first_slots()
            ids = [self._slots[slot].id for slot in firsts]
            found = places.revise(firsts, ids, self.threshold)
            revised = [Revision(scan, id) for scan, id in found]
        if match.id != NO_VIEW or match.is_ambiguous:
            places.note_answer(self._stats.processed, match.id)
        self._stats.revised += len(revised)
        return replace(match, revised=tuple(revised))

    def _match_view(self, view: View, best: Candidate) -> ViewMatch:
        slot = self._slots[best.slot]
        slot.use(self._stats.processed)
        # Another view of the place, if it is wanted.
        stored = (
            self.config.policy != "first"
            and best.similarity < self.config.store_below
            and sum(other.id == slot.id for other in self._slots) < self.config.per_place
        )
        if stored:
            self._store(view, slot.id)
        self._stats.matched += 1
        why = self.comparison.explain(best.similarity, self.threshold)
        return ViewMatch(
            id=slot.id,
            similarity=best.similarity,
            is_new=False,
            reason=f"matched view {slot.id}: {why}",
            stored=stored,
            matched=slot.number,
            relative_pose=best.relative_pose,
        )

    def _start_place(self, view: View, best: Candidate | None) -> ViewMatch:
        id = self._stats.new
        reason = f"new view {id}: nothing is stored yet"
        if best is not None and best.rejected:
            reason = f"new view {id}: the second stage rejected the best ones"
        elif best is not None:
            why = self.comparison.explain(best.similarity, self.threshold)
            reason = f"new view {id}: the best is view {self._slots[best.slot].id}, {why}"
        self._store(view, id)
        self._stats.new += 1
        return ViewMatch(id, 0.0 if best is None else best.similarity, True, reason, True)

    def _store(self, view: View, id: int) -> None:
        if 0 < self.config.max_views <= len(self._slots):
            least = self._least_needed()
            self._stats.bytes -= self.comparison.size_of(least)
            self._stats.dropped += 1
            self.comparison.remove(least)
            del self._slots[least]
            if self._filter is not None:
                self._filter.remove(least)
        self._stats.bytes += self.comparison.add(view)
        number = self._stats.processed
        self._slots.append(Slot(id, number, number))
        if self._filter is not None:
            self._filter.store()

    def _least_needed(self) -> int:
        """The slot of the view to drop.

        A view that was recognised after an absence is expected again, and kept for twice that
        absence. Of those that never came back one is dropped at random: dropping the oldest would,
        on a tour of more places than fit, drop each one just before the robot comes back to it.
        """
        now, slots = self._stats.processed, self._slots
        came_back = [slot.absent >= _ABSENCE * len(slots) for slot in slots]
        late = [n for n, s in enumerate(slots) if came_back[n] and now - s.used > 2 * s.absent]
        never = [n for n, back in enumerate(came_back) if not back]
        if never and not late:
            # Decided by the number of the scan, so that a resumed run equals an uninterrupted one.
            return random.Random(now).choice(never)
        return min(late or range(len(slots)), key=lambda n: slots[n].used)

    def save(self, target: PathLike | BinaryIO) -> None:
        """Save everything that ``load`` needs to resume exactly from here.

        Args:
            target: path of a file, which is written atomically, or a binary stream.

        Raises:
            DataError: the file cannot be written.
        """
        with self._lock:
            about = {
                "comparison": self.comparison.kind,
                "threshold": self.threshold,
                "views": self.config.model_dump(mode="json"),
                "fusion": self.fusion_config.model_dump(mode="json"),
                "descriptors": self.descriptor_config.model_dump(mode="json"),
                "stats": asdict(self.stats),
            }
            slots = np.array([astuple(slot) for slot in self._slots], np.int64).reshape(-1, 4)
            parts = {"state": self.comparison.state()}
            if self._filter is not None:
                parts["filter"] = self._filter.state()
            state = join_parts(parts)
        save_archive(target, FORMAT, about, {"slots": slots, **state})

    @classmethod
    def load(
        cls, source: PathLike | BinaryIO, *, comparison: Comparison | None = None
    ) -> "ViewMatcher":
        """Resume from what ``save`` wrote.

        Args:
            source: path of the file, or a binary stream.
            comparison: for a matcher that was given one: an empty comparison of the same kind.

        Raises:
            DataError: the file is missing, truncated, damaged, of another version or of another
                comparison; the message names the file.
        """
        with load_archive(source, FORMAT, "a stored view matcher") as (about, arrays):
            matcher = cls(
                merged(ViewMatcherConfig(), about["views"]),
                fusion=merged(FusionConfig(), about["fusion"]),
                descriptors=merged(DescriptorConfig(), about["descriptors"]),
                comparison=comparison,
            )
            matcher._restore(about, arrays)
        return matcher

    def _restore(self, about: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
        kind = about["comparison"]
        if kind != self.comparison.kind:
            raise DataError(
                f"it compares {kind}, expected {self.comparison.kind}: name the "
                "comparison it was made with (comparison=...)",
                code="other-kind",
                fields=[kind, self.comparison.kind],
            )
        slots, filtered = arrays["slots"], part_of(arrays, "filter")
        self.comparison.restore(part_of(arrays, "state"))
        is_table = slots.dtype == np.int64 and slots.ndim == 2 and slots.shape[1] == 4
        if not is_table or len(slots) != len(self.comparison):
            raise DataError(f"{len(self.comparison)} views, but slots {slots.dtype} {slots.shape}")
        self.threshold = float(about["threshold"])
        self._slots = [Slot(*row) for row in slots.tolist()]
        if filtered:
            self._filter = PlaceFilter(self.config.places)
            self._filter.restore(filtered, len(self._slots))
        self._stats = check_types(ViewStats(**about["stats"]))
