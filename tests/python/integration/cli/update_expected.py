# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Write ``expected/*.txt`` anew; read what git diff says of them."""

import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "support"))

from expected_output import update

if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        update(Path(folder).resolve())
