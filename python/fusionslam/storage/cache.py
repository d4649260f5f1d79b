# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The cache folder."""

import os
from pathlib import Path


def cache_folder() -> Path:
    """Path of the user's cache, or the folder that FUSIONSLAM_CACHE names."""
    from platformdirs import user_cache_dir

    return Path(os.environ.get("FUSIONSLAM_CACHE") or user_cache_dir("fusionslam"))
