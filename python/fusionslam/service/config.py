# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Configuration of the web service."""

from fusionslam.config import Section, option


class ServiceConfig(Section):
    """Where the service listens, and how much it does for whom."""

    host: str = option("127.0.0.1", "name or address to listen on; 127.0.0.1 is this machine alone")
    port: int = option(8766, "to listen on; 0 is any that is free", ge=0, le=65535)
    requests_per_minute: int = option(
        600, "of one client, by its API key or else its address; 0 is no limit", ge=0
    )
    max_request_mb: float = option(32.0, "largest body of a request", unit="MB", gt=0, le=4096)
    max_points: int = option(2_000_000, "most points of a cloud", ge=1)
    max_vectors: int = option(256, "most vectors of one query", ge=1)
    max_k: int = option(100, "most candidates for each of them", ge=1)
    max_positions: int = option(20_000, "most positions of a site that are sent", ge=1)
    workers: int = option(
        0, "threads that search, and as many that describe; 0 is one a core", ge=0, le=1024
    )
    max_waiting: int = option(
        128, "requests that are worked on or wait for it; further ones are turned away", ge=1
    )
    max_waiting_of_one: int = option(32, "of these, those of one client", ge=1)
    max_bodies_of_one: int = option(256, "bodies that one client sends at a time", ge=1)
    body_timeout_s: float = option(30.0, "longest time to send a body", unit="s", gt=0)
    head_timeout_s: float = option(
        10.0, "longest time until the head of a request is there, and between two", unit="s", gt=0
    )
    max_connections: int = option(
        2000, "open at a time; of more, that which has waited longest is closed", ge=1
    )
    behind_proxy: bool = option(
        False, "whether a proxy on this machine says in X-Forwarded-For who asks"
    )

    @property
    def max_bytes(self) -> int:
        """Bytes of the largest body."""
        return int(self.max_request_mb * 1e6)
