# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The number of places for those who watch the service, whatever else it has to do."""

import asyncio
from concurrent.futures import ThreadPoolExecutor

from fusionslam.errors import FusionSlamError
from fusionslam.service.places import ServedPlaces


class PlaceCount:
    """Counts places in a thread of its own, so that heavy queries do not delay it.

    Whoever asks while they are counted gets that number, too: nobody, not even without a key, can
    keep more than this thread busy. To be used from the event loop only.

    Args:
        places: that are counted.
    """

    def __init__(self, places: ServedPlaces) -> None:
        self._places = places
        self._pool = ThreadPoolExecutor(1, "fusionslam-count")
        self._counting: asyncio.Future[int | None] | None = None

    async def get(self) -> int | None:
        """Return the number of places; None if they cannot be read."""
        if self._counting is None or self._counting.done():
            loop = asyncio.get_running_loop()
            self._counting = loop.run_in_executor(self._pool, self._count)
        return await asyncio.shield(self._counting)  # the client may be gone before

    def close(self) -> None:
        """End the thread."""
        self._pool.shutdown(wait=True, cancel_futures=True)

    def _count(self) -> int | None:
        try:
            return len(self._places)
        except FusionSlamError:
            return None
