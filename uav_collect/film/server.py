"""Serves the page of a mission in flight, and what comes of it, to browsers of this machine.

A thread of its own does so. Each page is sent what it lacks, as fast as it takes it: one that is
slow gets it later, one that takes nothing is dropped, and nobody else waits for either.

No other site can read or steer: a request must name this server as its host, which a name that
somebody else lets point here does not, and a page that listens must come from here.
"""

import asyncio
from bisect import bisect_left
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from http import HTTPStatus
from ipaddress import ip_address
import json
import logging
import threading
from typing import Any
from urllib.parse import parse_qs, urlsplit

from uav_collect.errors import FilmError, RefusedError
from uav_collect.film.steering import MOST_BYTES, Wish, wish_of
from websockets.asyncio.server import serve, ServerConnection
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

MOST_PAGES = 64  # that listen at once
_PATIENCE_S = 10.0  # for a page to take what it was sent, or to answer at all
_CLOSE_S = 1.0  # for one that is to leave
_MOST_AT_ONCE = 500  # updates in one message
_MOST_ANSWERS = 32  # that wait for a page to take them
_LIVE = '/live'
_HEADERS = {
    'Cache-Control': 'no-store',
    'Content-Security-Policy': "frame-ancestors 'none'",
    'Cross-Origin-Resource-Policy': 'same-origin',
    'Referrer-Policy': 'no-referrer',
    'X-Content-Type-Options': 'nosniff',
}
_LOG = logging.getLogger(__name__)
_LOG.setLevel(logging.CRITICAL)  # what browsers do is no news

Values = Mapping[str, object]  # of JSON
MakePage = Callable[[Values | None, str], bytes]  # of what a page begins with, and where it asks
OnWish = Callable[[Wish, 'Page'], str]  # what to say at once; answers may come later


class Page:
    """A page that listens: how far it has got, and what it alone is to be told."""

    def __init__(self, connection: ServerConnection, mission: str) -> None:
        """Know where it stands."""
        self.connection = connection
        self.mission = mission  # that it shows
        self.n_sent = 0  # updates that it has, or was sent
        self.latest = mission  # the latest one that it knows of
        self.state = ''  # as it was last sent
        self.answers: list[str] = []
        self.news = asyncio.Event()


@dataclass
class _Shown:
    """What all pages show; only the server's thread reads and writes it."""

    mission: str = ''
    opening: Values | None = None
    updates: list[Values] = field(default_factory=list)
    n_events: list[int] = field(default_factory=list)  # of the mission, up to each update
    state: str = ''

    def n_updates_before(self, n_events: int) -> int:
        """How many updates come before the latest one of a page that has so many events.

        That one comes again: an event and the end of its mission count as many.
        """
        return bisect_left(self.n_events, n_events)


class PageServer:
    """The page and those who look at it."""

    def __init__(self, host: str, port: int, make_page: MakePage, on_wish: OnWish) -> None:
        """Serve from now on.

        Args:
            host: name or address of this machine to listen at.
            port: 0: any that is free.
            make_page: gives the page.
            on_wish: called, in the server's thread, with each wish of a page.

        Raises:
            FilmError: nobody can listen there.
        """
        self._host, self._make_page, self._on_wish = host, make_page, on_wish
        self._shown, self._pages = _Shown(), set[Page]()
        self._loop = asyncio.new_event_loop()
        self._server: Any = None
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True, name='pages')
        self._thread.start()
        try:
            asyncio.run_coroutine_threadsafe(self._listen(port), self._loop).result()
        except (OSError, UnicodeError) as error:
            self._end_loop()
            why = getattr(error, 'strerror', None) or error
            raise FilmError(f'the page cannot be served at {host}, port {port}: {why}') from error

    @property
    def url(self) -> str:
        """Where the page is."""
        host, port = self._server.sockets[0].getsockname()[:2]
        is_any = ip_address(host).is_unspecified
        shown = 'localhost' if is_any else host
        return f'http://[{shown}]:{port}/' if ':' in shown else f'http://{shown}:{port}/'

    def begin(self, mission: str, opening: Values) -> None:
        """Show another mission.

        Args:
            mission: its id.
            opening: what a page of it begins with.
        """
        self._call(self._begin, mission, opening)

    def add(self, n_events: int, update: Values) -> None:
        """Let all pages have more of the mission.

        Args:
            n_events: how many events of the mission there were up to then; never less than before.
            update: what there is to show.
        """
        self._call(self._add, n_events, {'n_events': n_events, **update})

    def tell(self, state: Values) -> None:
        """Let all pages know how things are; the latest state alone counts."""
        self._call(self._tell, json.dumps(state))

    def answer(self, page: Page, text: str) -> None:
        """Let one page know what came of its wish."""
        self._call(self._answer, page, text)

    def close(self) -> None:
        """Leave all pages, and end."""
        with suppress(TimeoutError):
            asyncio.run_coroutine_threadsafe(self._close(), self._loop).result(2.0 * _CLOSE_S)
        self._end_loop()

    def _call(self, deed: Callable[..., None], *arguments: object) -> None:
        with suppress(RuntimeError):  # it has ended
            self._loop.call_soon_threadsafe(deed, *arguments)

    def _end_loop(self) -> None:
        ending = self._loop.shutdown_default_executor()
        asyncio.run_coroutine_threadsafe(ending, self._loop).result()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    async def _listen(self, port: int) -> None:
        self._server = await serve(
            self._attend,
            *(self._host, port),
            process_request=self._process,
            max_size=MOST_BYTES,
            max_queue=4,
            open_timeout=_PATIENCE_S,
            ping_interval=_PATIENCE_S,
            ping_timeout=_PATIENCE_S,
            close_timeout=_CLOSE_S,
            compression=None,
            logger=_LOG,
        )

    async def _close(self) -> None:
        for page in self._pages:
            page.connection.transport.abort()
        self._server.close()
        with suppress(TimeoutError):
            await asyncio.wait_for(self._server.wait_closed(), _CLOSE_S)
        others = asyncio.all_tasks() - {asyncio.current_task()}
        for task in others:
            task.cancel()
        await asyncio.gather(*others, return_exceptions=True)

    def _begin(self, mission: str, opening: Values) -> None:
        self._shown.mission, self._shown.opening = mission, opening
        self._shown.updates, self._shown.n_events = [], []
        for page in self._pages:
            page.n_sent = 0
        self._wake()

    def _add(self, n_events: int, update: Values) -> None:
        self._shown.updates.append(update)
        self._shown.n_events.append(n_events)
        self._wake()

    def _tell(self, state: str) -> None:
        self._shown.state = state
        self._wake()

    def _answer(self, page: Page, text: str) -> None:
        if text:
            page.answers.append(text)
            page.news.set()

    def _wake(self) -> None:
        for page in self._pages:
            page.news.set()

    def _process(self, connection: ServerConnection, request: Request) -> Response | None:
        """Answer a request for the page; let a page listen that comes from here."""
        port = self._server.sockets[0].getsockname()[1]
        host = request.headers.get('Host', '')
        if not is_own_host(host, self._host, port):
            return _text(HTTPStatus.MISDIRECTED_REQUEST, 'ask for this server by its address')
        path = urlsplit(request.path).path
        if path == '/':
            return self._page(host)
        if path != _LIVE:
            return _text(HTTPStatus.NOT_FOUND, 'there is nothing here')
        if request.headers.get('Origin') != f'http://{host}':
            return _text(HTTPStatus.FORBIDDEN, 'only a page of this server may listen')
        if len(self._pages) >= MOST_PAGES:
            return _text(HTTPStatus.SERVICE_UNAVAILABLE, f'{MOST_PAGES} pages listen already')
        return None

    def _page(self, host: str) -> Response:
        shown = self._shown
        begun: Values | None = None
        if shown.opening is not None:
            begun = {**shown.opening, 'live': {'mission': shown.mission}}
        content = self._make_page(begun, f'ws://{host}')
        return _response(HTTPStatus.OK, 'text/html; charset=utf-8', content)

    async def _attend(self, connection: ServerConnection) -> None:
        """Send a page what it lacks, and hear what it wishes, until it leaves."""
        asked = parse_qs(urlsplit(connection.request.path).query)  # type: ignore[union-attr]
        page = Page(connection, asked.get('mission', [''])[0])
        n_events = asked.get('n_events', [''])[0]
        if page.mission == self._shown.mission and n_events.isdecimal() and len(n_events) < 10:
            page.n_sent = self._shown.n_updates_before(int(n_events))
        self._pages.add(page)
        sending = asyncio.create_task(self._send_news(page))
        try:
            async for text in connection:
                if len(page.answers) > _MOST_ANSWERS:
                    connection.transport.abort()  # it asks, and does not listen
                    return
                self._answer(page, self._heard(text, page))
        except ConnectionClosed:
            pass
        finally:
            self._pages.discard(page)
            sending.cancel()

    def _heard(self, text: str | bytes, page: Page) -> str:
        try:
            return self._on_wish(wish_of(text), page)
        except RefusedError as error:
            return f'refused: {error}'

    async def _send_news(self, page: Page) -> None:
        try:
            while True:
                page.news.clear()
                while (message := self._news_for(page)) is not None:
                    async with asyncio.timeout(_PATIENCE_S):
                        await page.connection.send(json.dumps(message, separators=(',', ':')))
                await page.news.wait()
        except TimeoutError:
            page.connection.transport.abort()  # to close in good order it would have to listen
        except ConnectionClosed:
            pass

    def _news_for(self, page: Page) -> Values | None:
        """The next message for a page; None when it knows all."""
        shown = self._shown
        if page.state != shown.state:
            page.state = shown.state
            return {'state': json.loads(shown.state)}
        if page.answers:
            said, page.answers = page.answers[0], page.answers[1:]
            return {'said': said}
        if shown.mission != page.latest:
            page.latest = shown.mission
            if shown.mission not in ('', page.mission):
                return {'mission': shown.mission}
        if shown.mission != page.mission:
            return None  # it comes again for that one
        more = shown.updates[page.n_sent : page.n_sent + _MOST_AT_ONCE]
        page.n_sent += len(more)
        return {'updates': more} if more else None


def is_own_host(host: str, own: str, port: int) -> bool:
    """Whether a request's host is this server, and no name that others let point to it.

    Args:
        host: as a browser has sent it.
        own: name or address that the server listens at.
        port: that it listens at.
    """
    try:
        parts = urlsplit(f'//{host}')
        name, named_port = parts.hostname or '', parts.port or 80
    except ValueError:
        return False
    if named_port != port or parts.netloc != host or parts.username is not None:
        return False
    if '%' in host:  # before a zone of an address, in which anything may stand
        return False
    return name in ('localhost', own.lower()) or _is_address(name)


def _is_address(name: str) -> bool:
    try:
        ip_address(name)
    except ValueError:
        return False
    return True


def _text(status: HTTPStatus, text: str) -> Response:
    return _response(status, 'text/plain; charset=utf-8', f'{text}\n'.encode())


def _response(status: HTTPStatus, kind: str, content: bytes) -> Response:
    fields = {'Content-Type': kind, 'Content-Length': str(len(content)), 'Connection': 'close'}
    return Response(status.value, status.phrase, Headers({**_HEADERS, **fields}), content)
