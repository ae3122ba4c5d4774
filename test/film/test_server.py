"""The server of pages: who may look and steer, and what each page is sent."""

from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
import http.client
import json
import socket
import threading

from processes import wait_until
import pytest
from uav_collect.errors import FilmError
from uav_collect.film import server
from uav_collect.film.server import is_own_host, Page, PageServer, Values
from uav_collect.film.steering import Wish
from websockets.sync.client import ClientConnection, connect

LONG_S = 600.0  # for what takes a moment


class Served(PageServer):
    """A server at a free port, and what its pages have wished."""

    def __init__(self, host: str = '127.0.0.1', port: int = 0) -> None:
        self.wishes: list[tuple[Wish, Page]] = []
        super().__init__(host, port, _page, self._note)

    @property
    def place(self) -> str:
        return self.url.removeprefix('http://').removesuffix('/')

    def _note(self, wish: Wish, page: Page) -> str:
        self.wishes.append((wish, page))
        return f'heard {wish.command}'

    def get(self, path: str, **headers: str) -> tuple[http.client.HTTPResponse, str]:
        with closing(http.client.HTTPConnection(self.place, timeout=LONG_S)) as asked:
            asked.request('GET', path, headers={'Host': self.place, **headers})
            answer = asked.getresponse()
            return answer, answer.read().decode()

    @contextmanager
    def page(self, mission: str = '', n_events: int = 0) -> Iterator[ClientConnection]:
        url = f'ws://{self.place}/live?mission={mission}&n_events={n_events}'
        with connect(url, origin=f'http://{self.place}') as connection:
            yield connection


def _page(begun: Values | None, connect_to: str) -> bytes:
    return json.dumps([begun, connect_to]).encode()


@pytest.fixture
def served() -> Iterator[Served]:
    it = Served()
    yield it
    it.close()


def heard(page: ClientConnection) -> dict[str, object]:
    said: dict[str, object] = json.loads(page.recv(LONG_S))
    return said


def heard_updates(page: ClientConnection) -> list[dict[str, object]]:
    updates = heard(page)['updates']
    assert isinstance(updates, list)
    return updates


def test_a_page_begins_with_the_mission_in_flight(served: Served) -> None:
    assert json.loads(served.get('/')[1]) == [None, f'ws://{served.place}']
    served.begin('w-0', {'seed': 3})
    [begun, _] = json.loads(served.get('/')[1])
    assert begun == {'seed': 3, 'live': {'mission': 'w-0'}}


def test_each_page_is_sent_what_it_lacks(served: Served) -> None:
    served.tell({'world': True})
    served.begin('w-0', {})
    for number in range(3):
        served.add(number + 1, {'event': number})
    updates = [{'n_events': number + 1, 'event': number} for number in range(4)]
    with served.page('w-0') as late, served.page('w-0', n_events=2) as early:
        assert heard(late) == heard(early) == {'state': {'world': True}}
        assert heard(late) == {'updates': updates[:3]}
        assert heard(early) == {'updates': updates[1:3]}  # the latest that it has comes again
        served.add(4, {'event': 3})
        assert heard(late) == heard(early) == {'updates': updates[3:]}


def test_what_a_page_lacks_is_counted_in_events_and_not_in_updates(
    served: Served,
) -> None:
    served.begin('w-0', {})
    served.add(5001, {'event': 5000})  # a viewer that came late
    served.add(5002, {'event': 5001})
    served.add(5002, {'is_over': True})
    with served.page('w-0', n_events=5002) as page:
        assert [it.get('event') for it in heard_updates(page)] == [5001, None]
    with served.page('w-0', n_events=17) as page:
        assert [it.get('event') for it in heard_updates(page)] == [5000, 5001, None]


def test_a_page_that_waited_for_its_mission_gets_all_of_it(served: Served) -> None:
    served.tell({'world': True})
    with served.page('w-0', n_events=7) as page:
        heard(page)
        served.begin('w-0', {})
        served.add(1, {'event': 0})
        assert [it.get('event') for it in heard_updates(page)] == [0]


def test_a_page_hears_of_the_next_mission_and_nothing_more_until_it_shows_it(
    served: Served,
) -> None:
    served.begin('w-0', {})
    with served.page('w-0') as page:
        served.begin('w-1', {})
        assert heard(page) == {'mission': 'w-1'}
        served.add(1, {'event': 0})
        served.tell({'world': False})
        assert heard(page) == {'state': {'world': False}}
    with served.page('w-1') as page:
        heard(page)
        assert [it.get('event') for it in heard_updates(page)] == [0]


def test_a_wish_is_heard_and_answered_to_its_page_alone(served: Served) -> None:
    with served.page() as page, served.page() as other:
        page.send('{"command": "pause"}')
        assert heard(page) == {'said': 'heard pause'}
        [(wish, asker)] = served.wishes
        assert wish == Wish(command='pause')
        served.answer(asker, 'paused')
        assert heard(page) == {'said': 'paused'}
        other.send('nonsense')
        refusal = str(heard(other)['said'])
        assert refusal.startswith('refused: this is no object of JSON')
    assert len(served.wishes) == 1


def test_a_page_that_sends_too_much_is_dropped(served: Served) -> None:
    with pytest.raises(server.ConnectionClosed), served.page() as page:
        page.send('x' * 100_000)
        while True:
            page.recv(LONG_S)


@contextmanager
def deaf_page(served: Served) -> Iterator[socket.socket]:
    """A page that is to be sent forty megabytes of its mission, and takes nothing."""
    with socket.create_connection(served.place.split(':'), timeout=LONG_S) as deaf:
        lines = (
            *('GET /live?mission=w-0 HTTP/1.1', f'Host: {served.place}', 'Upgrade: websocket'),
            *(f'Origin: http://{served.place}', 'Connection: Upgrade'),
            *('Sec-WebSocket-Version: 13', f'Sec-WebSocket-Key: {"a" * 22}==', '', ''),
        )
        deaf.sendall('\r\n'.join(lines).encode())
        assert deaf.recv(12) == b'HTTP/1.1 101'
        wait_until(lambda: served._pages)
        for number in range(40):
            served.add(number + 1, {'event': number, 'much': 'x' * 1_000_000})
        yield deaf


def test_a_page_that_takes_nothing_holds_nobody_up(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, '_PATIENCE_S', LONG_S)
    served.begin('w-0', {})
    with deaf_page(served), served.page('w-0', n_events=40) as quick:
        assert [it['event'] for it in heard_updates(quick)] == [39]
        assert len(served._pages) == 2


def test_a_page_that_takes_nothing_is_dropped(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, '_PATIENCE_S', 0.1)
    served.begin('w-0', {})
    with deaf_page(served) as deaf:
        wait_until(lambda: not served._pages)
        n_read = 0
        with suppress(ConnectionResetError):
            while content := deaf.recv(1_000_000):
                n_read += len(content)
        assert n_read < 30_000_000  # of forty


@pytest.mark.parametrize(
    ('path', 'headers', 'status'),
    [
        ('/', {'Host': 'attacker.example:{port}'}, 421),
        ('/', {'Host': '127.0.0.1:1'}, 421),
        ('/', {'Host': ''}, 421),
        ('/live', {}, 403),
        ('/live', {'Origin': 'http://attacker.example'}, 403),
        ('/live', {'Origin': 'null'}, 403),
        ('/live', {'Origin': 'https://127.0.0.1:{port}'}, 403),
        ('/live', {'Host': 'attacker.example:{port}', 'Origin': 'http://attacker.example'}, 421),
        ('/etc/passwd', {}, 404),
    ],
)
def test_who_comes_from_elsewhere_is_refused(
    path: str, headers: dict[str, str], status: int, served: Served
) -> None:
    port = served.place.rpartition(':')[2]
    named = {name: value.format(port=port) for name, value in headers.items()}
    answer, text = served.get(path, **named)
    assert answer.status == status
    assert len(text.splitlines()) == 1


def test_no_other_site_may_frame_the_page_or_keep_it(served: Served) -> None:
    answer, _ = served.get('/')
    assert answer.headers['Content-Security-Policy'] == "frame-ancestors 'none'"
    assert answer.headers['Cache-Control'] == 'no-store'
    assert answer.headers['X-Content-Type-Options'] == 'nosniff'


@pytest.mark.parametrize(
    ('host', 'is_own'),
    [
        ('127.0.0.1:80', True),
        ('127.0.0.1', True),
        ('localhost', True),
        ('LOCALHOST:80', True),
        ('[::1]:80', True),
        ('192.168.0.7:80', True),
        ('drone.lan', True),
        ('drone.lan.attacker.example', False),
        ('attacker.example', False),
        ('localhost:81', False),
        ('localhost@attacker.example', False),
        ('user@localhost', False),
        ('localhost/', False),
        ('localhost:x', False),
        ('[::1', False),
        ('[::1%"><img src=x>]:80', False),
        ('[fe80::1%eth0]:80', False),
        ('', False),
    ],
)
def test_a_host_is_own_by_address_or_name(host: str, is_own: bool) -> None:
    assert is_own_host(host, 'drone.lan', 80) is is_own


def test_a_port_that_is_taken_is_said_in_a_line(served: Served) -> None:
    port = int(served.place.rpartition(':')[2])
    with pytest.raises(FilmError, match=rf'at 127\.0\.0\.1, port {port}: '):
        Served(port=port)


@pytest.mark.parametrize('host', ['no such host', '203.0.113.7', 'a' * 300])
def test_a_host_that_is_not_this_machine_is_said_in_a_line(host: str) -> None:
    n_threads = threading.active_count()
    with pytest.raises(FilmError, match=r'^the page cannot be served at ') as refused:
        Served(host=host)
    assert '\n' not in str(refused.value)
    assert threading.active_count() == n_threads


def test_an_end_leaves_all_pages_at_once() -> None:
    served = Served()
    with pytest.raises(server.ConnectionClosed), served.page() as page:
        served.close()
        page.recv(LONG_S)
    served.add(1, {'event': 0})  # to nobody
