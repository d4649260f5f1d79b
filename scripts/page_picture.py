# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Takes a picture out of a page, by its name: page_picture.py PAGE NAME OUT.

The pictures of README.md and docs/stages/mapping.md, after fusionslam demo -o out/demo:
    python scripts/page_picture.py out/demo/map.html trajectories-0.png docs/images/map_demo.png
    python scripts/page_picture.py out/demo/map.html cloud.jpg docs/images/map_from_above.jpg
"""

import base64
import re
import sys
from pathlib import Path


def main() -> None:
    page, name, out = sys.argv[1:]
    text = Path(page).read_text(encoding="utf-8")
    found = re.search(rf'src="data:image/\w+;base64,([^"]+)" alt="{re.escape(name)}"', text)
    if found is None:
        names = re.findall(r'src="data:image/[^"]+" alt="([^"]+)"', text)
        raise SystemExit(f"{page} has no picture {name}: expected one of {', '.join(names)}")
    Path(out).write_bytes(base64.b64decode(found[1]))


if __name__ == "__main__":
    main()
