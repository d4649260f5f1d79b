# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The cache folder."""

import hashlib
import json
import os
from pathlib import Path
from typing import Any


def cache_folder() -> Path:
    """Path of the user's cache, or the folder that FUSIONSLAM_CACHE names."""
    from platformdirs import user_cache_dir

    return Path(os.environ.get("FUSIONSLAM_CACHE") or user_cache_dir("fusionslam"))


def cached_path(name: str, identity: Any, suffix: str = "") -> Path:
    """Path in the cache of what a value, in types that JSON can hold, decides: NAME-digest."""
    text = json.dumps(identity, sort_keys=True)
    return cache_folder() / f"{name}-{hashlib.sha256(text.encode()).hexdigest()[:12]}{suffix}"
