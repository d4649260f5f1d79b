# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Protocols for judging matches, by name, and their parameters."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from fusionslam import help_texts
from fusionslam.config import Section, explain_choice, merged, option
from fusionslam.errors import ConfigError
from fusionslam.storage.arrays import Mask


@dataclass(frozen=True)
class PoseBound:
    """Largest error of a match's relative pose: metres and degrees, both inclusive."""

    metres: float
    degrees: float


@dataclass(frozen=True)
class Protocol:
    """When a match is correct and which queries recall counts; the rest is ``COMMON_RULES``.

    Attributes:
        name: as in configurations and files.
        denominator: the queries that recall is a share of, in words.
        source: who uses it.
        relevant: (correct, revisit), bool (N,) each -> bool (N,), the queries that recall counts.
        bound: of the error of a correct match's pose; None where the places decide.
    """

    name: str
    denominator: str
    source: str
    relevant: Callable[[Mask, Mask], Mask]
    bound: PoseBound | None = None

    @property
    def correct(self) -> str:
        """When a match is correct, in words."""
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
    "its distance is 1 - probability. Precision is correct accepted matches / accepted matches."
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
    )
}


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


class EvaluationConfig(Section):
    """Settings for judging matches against true positions."""

    protocol: Literal["revisit", "perdomo2019", "pose-1m-5deg", "pose-2m-5deg"] = option(
        "revisit", help_texts.PROTOCOL
    )
    radius: float = option(10.0, help_texts.RADIUS, unit="m", gt=0, allow_inf_nan=False)
    window: int = option(50, help_texts.EVALUATION_WINDOW, unit="frames", ge=0)


DEFAULTS = EvaluationConfig()


def validate_config(**values: Any) -> EvaluationConfig:
    """Return the configuration with these values.

    Raises:
        ConfigError: a value is out of range or of the wrong type; the message names the key.
    """
    if "protocol" in values:
        find_protocol(values["protocol"])
    return merged(DEFAULTS, values, "evaluation.")
