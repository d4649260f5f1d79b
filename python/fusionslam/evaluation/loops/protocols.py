# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Protocols for judging matches, by name, and their parameters."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from pydantic import model_validator

from fusionslam.base import texts
from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Mask
from fusionslam.config import Section, explain_choice, merged, option
from fusionslam.errors import ConfigError


@dataclass(frozen=True)
class PoseBound:
    """Largest error of a match's relative pose: metres and degrees, both inclusive."""

    metres: float
    degrees: float


@dataclass(frozen=True)
class PairRule:
    """Which pairs of frames are judged beside all those of one place.

    Attributes:
        far: frames farther apart than this (metres) are at different places; pairs between the
            radius and this are left out.
        negatives: number of pairs of different places that are drawn for each pair of one place.
    """

    far: float
    negatives: int


@checked
@dataclass(frozen=True)
class Protocol:
    """When a match is correct and which queries recall counts; the rest is ``COMMON_RULES``.

    Attributes:
        name: as in configurations and files.
        denominator: the queries that recall is a share of, in words.
        source: who uses it.
        relevant: (correct, revisit), bool (N,) each -> bool (N,), the queries that recall counts.
        bound: of the error of a correct match's pose; None where the places decide.
        radius, window: metres and frames that hold unless others are given.
        pairs: the pairs of frames that are judged; None where nearest candidates are.
        figures: those that are published under it, as attributes of ``PrecisionRecall``.
        peer: whether it is another paper's, by which runs are judged only if it is asked for.
    """

    name: str
    denominator: str
    source: str
    relevant: Callable[[Mask, Mask], Mask]
    bound: PoseBound | None = None
    radius: float = 10.0
    window: int = 50
    pairs: PairRule | None = None
    figures: tuple[str, ...] = ()
    peer: bool = False

    @property
    def correct(self) -> str:
        """When a match is correct, in words."""
        if self.pairs is not None:
            return (
                "the two true positions of a pair are less than the radius apart (3-D, strictly); "
                f"{self.pairs.negatives} pairs more than {self.pairs.far:g} m apart are drawn for "
                "each of these, the others are left out"
            )
        if self.bound is None:
            return "the two true positions are less than the radius apart (3-D, strictly)"
        return (
            f"its relative pose is at most {self.bound.metres:g} m and {self.bound.degrees:g} "
            "degrees off the true one, whatever the radius"
        )


COMMON_RULES = (
    "Each frame is a query. Its candidates are the earlier frames j <= i - window - 1. The match "
    "is the candidate whose descriptor is nearest (of equally near ones the lowest index). A "
    "threshold accepts every match whose distance is at most the threshold; equal distances make "
    "one threshold. Of verified loops the match is the candidate whose pose is most probable, and "
    "its distance is 1 - probability. Precision is correct accepted matches / accepted matches. "
    "Where pairs are judged, a frame and each of its candidates take the place of a match."
)

_REVISITS = "queries that revisit a place: some candidate lies within the radius"

PROTOCOLS = {
    protocol.name: protocol
    for protocol in (
        Protocol(
            name="revisit",
            denominator=_REVISITS,
            source="the usual definition; also counts the places that no threshold can find",
            relevant=lambda correct, revisit: revisit,
        ),
        Protocol(
            name="perdomo2019",
            denominator="queries whose nearest candidate is correct, so recall always ends at 1",
            source="the program of Perdomo 2019, with which the published figures were computed",
            relevant=lambda correct, revisit: correct,
        ),
        *(
            Protocol(
                name=f"pose-{bound.metres:g}m-{bound.degrees:g}deg",
                denominator=_REVISITS,
                source="loops that are to correct a map; needs the poses of verified loops",
                relevant=lambda correct, revisit: revisit,
                bound=bound,
            )
            for bound in (PoseBound(1, 5), PoseBound(2, 5))
        ),
        Protocol(
            name="ssc",
            denominator="all pairs of one place",
            source="Li et al. 2021 (SSC), table 1, whose pairs are those of Kong et al. 2020 "
            "(SG_PR) with 100 negatives for each positive",
            relevant=lambda correct, revisit: revisit,
            radius=3.0,
            pairs=PairRule(far=20.0, negatives=100),
            figures=("max_f1", "extended_precision"),
            peer=True,
        ),
        Protocol(
            name="scancontext",
            denominator=_REVISITS,
            source="Kim, Kim 2018 (Scan Context), which shows curves and prints no figures",
            relevant=lambda correct, revisit: revisit,
            radius=4.0,
            peer=True,
        ),
        Protocol(
            name="solid",
            denominator=_REVISITS,
            source="Kim et al. 2024 (SOLiD), single sessions; the AUC is that of the ROC curve",
            relevant=lambda correct, revisit: revisit,
            window=100,
            figures=("top1", "roc_auc", "max_f1"),
            peer=True,
        ),
    )
}

USUAL_PROTOCOLS = tuple(name for name, protocol in PROTOCOLS.items() if not protocol.peer)
"""Those by which runs are judged together, at one radius and window."""


def judged_together(name: str) -> tuple[str, ...]:
    """Return the protocols by which a run is judged if one is chosen: it alone if it is a peer's.

    Raises ConfigError if it is unknown.
    """
    return (name,) if find_protocol(name).peer else USUAL_PROTOCOLS


@checked
def find_protocol(name: str) -> Protocol:
    """Return the protocol with this name. Raises ConfigError if it is unknown."""
    if name in PROTOCOLS:
        return PROTOCOLS[name]
    problem = f"unknown protocol {name!r}: {explain_choice(str(name), PROTOCOLS)}"
    raise ConfigError(problem, code="unknown-protocol", fields=(str(name),))


def check_bound(name: str, has_poses: bool) -> None:
    """Raise ConfigError (code "needs-poses") if a protocol judges poses and these are unknown."""
    if find_protocol(name).bound is not None and not has_poses:
        places = ", ".join(each.name for each in PROTOCOLS.values() if each.bound is None)
        raise ConfigError(
            f"evaluation.protocol: {name} compares the poses of verified loops with true ones, and "
            f"these are not known here: expected {places}",
            code="needs-poses",
            fields=("evaluation.protocol", name),
        )


def check_matches(name: str) -> None:
    """Raise ConfigError (code "needs-descriptors") if a protocol judges pairs, not matches."""
    if find_protocol(name).pairs is not None:
        names = ", ".join(each.name for each in PROTOCOLS.values() if each.pairs is None)
        raise ConfigError(
            f"evaluation.protocol: {name} judges pairs of descriptors, and only matches are known "
            f"here: expected {names}",
            code="needs-descriptors",
            fields=("evaluation.protocol", name),
        )


class EvaluationConfig(Section):
    """Settings for judging matches against true positions.

    Radius and window are the protocol's own unless they are given.
    """

    protocol: Literal[
        "revisit",
        "perdomo2019",
        "pose-1m-5deg",
        "pose-2m-5deg",
        "ssc",
        "scancontext",
        "solid",
    ] = option("revisit", texts.PROTOCOL)
    radius: float = option(10.0, texts.RADIUS, unit="m", gt=0, allow_inf_nan=False)
    window: int = option(50, texts.EVALUATION_WINDOW, unit="frames", ge=0)

    @model_validator(mode="after")
    def _take_from_protocol(self) -> "EvaluationConfig":
        """Fill in what was not given, which stays not given for another protocol."""
        for name in {"radius", "window"} - self.model_fields_set:
            self.__dict__[name] = getattr(PROTOCOLS[self.protocol], name)
        return self

    def given(self) -> dict[str, Any]:
        """Return the values that are not the protocol's own, so that another one can bring its."""
        rule = PROTOCOLS[self.protocol]
        values = self.model_dump()
        own = {name for name in ("radius", "window") if values[name] == getattr(rule, name)}
        return {name: value for name, value in values.items() if name not in own}


DEFAULTS = EvaluationConfig()


def validate_config(**values: Any) -> EvaluationConfig:
    """Return the configuration with these values; None stands for what is not given.

    Raises:
        ConfigError: a value is out of range or of the wrong type; the message names the key.
    """
    if "protocol" in values:
        find_protocol(values["protocol"])
    given = {name: value for name, value in values.items() if value is not None}
    return merged(DEFAULTS, given, "evaluation.")
