"""Settings shared by all tests."""

from __future__ import annotations

import hypothesis

hypothesis.settings.register_profile("dynhair", deadline=None, derandomize=True, max_examples=25)
hypothesis.settings.load_profile("dynhair")
