# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What is remembered of the drives at a site between calls of ``fleet merge``."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from fusionslam.storage.archive import load_json, save_json

_FORMAT = "fusionslam.fleet_site.1"


@dataclass
class SiteRecord:
    """Which state of each recording is in the maps of a site, and which drives were refused.

    Attributes:
        path: of the file, beside the joint map.
        contents: names of what the recordings hold now, by session; "" where that is unknown.
        settings: all else that maps and loops between them depend on.
        begun: contents of which the maps of single drives were begun.
        built: states, with settings, of which they were completed.
        joined: contents that are in the joint map.
        refused: by the first session of a joint map and the session that does not join it: the
            state of both, and why.
    """

    path: Path
    contents: Mapping[str, str]
    settings: str
    begun: dict[str, str] = field(default_factory=dict)
    built: dict[str, str] = field(default_factory=dict)
    joined: dict[str, str] = field(default_factory=dict)
    refused: dict[str, dict[str, tuple[str, str]]] = field(default_factory=dict)

    @classmethod
    def load(cls, path: Path, contents: Mapping[str, str], settings: str = "") -> "SiteRecord":
        """Read the record of a site; an empty one if there is none.

        Raises:
            DataError: the file is damaged.
        """
        record = cls(path, contents, settings)
        if path.exists():
            with load_json(path, _FORMAT, "what is known of a site's drives") as values:
                for name in ("begun", "built", "joined"):
                    getattr(record, name).update(values[name])
                for first, reasons in values["refused"].items():
                    pairs = {name: (str(state), str(why)) for name, (state, why) in reasons.items()}
                    record.refused[first] = pairs
        return record

    def save(self) -> None:
        """Write the record. Raises DataError if it cannot be written."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        names = ("begun", "built", "joined", "refused")
        save_json(self.path, _FORMAT, {name: getattr(self, name) for name in names})

    def has_changed(self, session: str, seen: dict[str, str]) -> bool:
        """Whether a recording holds something else than was seen of it.

        One that was not seen before is taken to be the same.

        Args:
            session: of the recording.
            seen: ``begun`` or ``joined``.
        """
        now = self.contents[session]
        if not seen.get(session):
            seen[session] = now
        return bool(now) and now != seen[session]

    def is_built(self, session: str) -> bool:
        """Whether the map of a drive was completed, of what the recording holds now."""
        return self.built.get(session) == self._digest([self.contents[session]])

    def note_built(self, session: str) -> None:
        """Remember that the map of a drive is complete."""
        self.built[session] = self._digest([self.contents[session]])
        self.save()

    def refusal(self, joint: Sequence[str], session: str) -> str | None:
        """Return why a drive did not join these sessions as they are now; None if it may."""
        state, reason = self.refused.get(joint[0], {}).get(session, ("", ""))
        return reason if state == self._state_of([*sorted(joint), session]) else None

    def note_refusal(self, joint: Sequence[str], session: str, reason: str) -> None:
        """Remember why a drive does not join the sessions of a joint map."""
        state = self._state_of([*sorted(joint), session])
        self.refused.setdefault(joint[0], {})[session] = state, reason
        self.save()

    def forget(self, session: str) -> None:
        """Delete all that is known of a drive."""
        for states in (self.begun, self.built, self.joined):
            states.pop(session, None)
        self.refused.pop(session, None)
        for reasons in self.refused.values():
            reasons.pop(session, None)

    def _state_of(self, sessions: Sequence[str]) -> str:
        return self._digest(
            [[each, self.joined.get(each, self.contents.get(each, ""))] for each in sessions]
        )

    def _digest(self, held: Sequence[object]) -> str:
        return hashlib.sha256(json.dumps([held, self.settings]).encode()).hexdigest()[:32]
