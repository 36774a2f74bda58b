"""The browser with which tests look at pages."""

import os
import shutil

import pytest

BROWSER = (
    shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
)


def need_browser():
    """A skip without Chromium, or a failure where it is required."""
    if BROWSER is None:
        reason = "pages are looked at in Chromium: run `make browser`"
        if os.environ.get("WHEELCHAIR_BROWSER") == "required":
            pytest.fail(reason)
        pytest.skip(reason)
