"""Films in a browser that all tests of a module share."""

from collections.abc import Iterator
from pathlib import Path

from browser import launched_browser, Watched
from film_pages import check_silence, show
import pytest


@pytest.fixture(scope='module')
def screen() -> Iterator[Watched]:
    """One page of one browser for all tests: to start either takes a second."""
    with launched_browser() as browser:
        yield Watched(browser)


@pytest.fixture
def watched(screen: Watched, film: Path) -> Iterator[Watched]:
    """The module's film, which must be silent and ask for nothing whatever a test does with it."""
    show(screen, film)
    yield screen
    check_silence(screen, film)
