# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What tests of report pages share."""

import pytest
from PIL import Image


@pytest.fixture
def unrendered(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are drawn but not rendered, which takes most of a page's time."""
    blank = Image.new("RGB", (8, 8))
    monkeypatch.setattr("fusionslam.report.page.images._render", lambda figure: blank)
