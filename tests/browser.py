"""Headless Chromium for tests of pages, where it and playwright are installed."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any


def chromium() -> str | None:
    """Path of the browser; None if it, or playwright, is missing."""
    try:
        import_module("playwright.sync_api")
    except ImportError:
        return None
    return shutil.which("chromium") or shutil.which("google-chrome")


@contextmanager
def opened(width: int = 1280, height: int = 760) -> Iterator[Any]:
    """Give an empty page, drawn by software where there is no graphics card."""
    playwright = import_module("playwright.sync_api")
    options = ["--no-sandbox"] if os.geteuid() == 0 else []
    options += ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    with playwright.sync_playwright() as kit:
        browser = kit.chromium.launch(executable_path=chromium(), args=options)
        page = browser.new_page(viewport={"width": width, "height": height})
        page.set_default_timeout(120_000)
        yield page
        browser.close()
