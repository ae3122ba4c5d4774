"""A real browser that shows pages to tests, and what it hears from them."""

from collections.abc import Iterator
from contextlib import contextmanager
import os
import shutil
from typing import Any

from processes import DEADLINE_S, wait_until
import pytest

_NAMES = ('chromium', 'chromium-browser', 'google-chrome')
_LOOK_MS = 20
_MISSING = 'needs a browser: apt install chromium'

Page = Any  # of playwright


@contextmanager
def launched_browser() -> Iterator[Any]:
    """Chromium without a screen; skips the test where there is none."""
    sync_api = pytest.importorskip('playwright.sync_api', reason=_MISSING)
    program = next(filter(None, map(shutil.which, _NAMES)), None)
    if program is None:
        pytest.skip(_MISSING)
    # As root there is no sandbox; a container's shared memory is small.
    flags = [
        '--disable-dev-shm-usage',
        '--disable-gpu',
        *(['--no-sandbox'] if os.geteuid() == 0 else []),
    ]
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=flags)
        yield browser
        browser.close()


class Watched:
    """A page, with all that it asks of the network and says on its console."""

    def __init__(self, browser: object) -> None:
        self.page: Page = browser.new_page()  # type: ignore[attr-defined]
        self.page.set_default_timeout(1000.0 * DEADLINE_S)
        self.requests: list[str] = []
        self.errors: list[str] = []
        self.page.on('request', lambda request: self.requests.append(request.url))
        self.page.on('pageerror', lambda error: self.errors.append(str(error)))
        self.page.on('console', lambda message: self._note(message))

    def _note(self, message: object) -> None:
        if message.type in ('error', 'warning'):  # type: ignore[attr-defined]
            self.errors.append(message.text)  # type: ignore[attr-defined]

    def wait_until(self, condition: str) -> None:
        """Wait until an expression is true on the page.

        Playwright's own way has the page evaluate text, which a page of ours does not allow.
        """
        try:
            wait_until(
                lambda: self._holds(condition),
                meanwhile=lambda: self.page.wait_for_timeout(_LOOK_MS),
            )
        except AssertionError as late:
            raise AssertionError(f'{condition}: {late}') from None

    def _holds(self, condition: str) -> bool:
        try:
            return bool(self.page.evaluate(condition))
        except Exception as error:
            if 'navigation' not in str(error):  # a page that begins anew, or leaves for another
                raise
            return False
