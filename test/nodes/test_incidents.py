"""Whoever writes incidents, and however many, the log stays readable."""

import pytest

pytest.importorskip('rclpy')

from uav_collect.errors import in_one_line, MOST_CHARACTERS
from uav_collect.nodes.incidents import Incidents


@pytest.mark.parametrize(
    ('text', 'line'),
    [
        ('one  line\n', 'one line'),
        ('\x1b[31mred\x00', '\\x1b[31mred\\x00'),
        ('x' * MOST_CHARACTERS, 'x' * MOST_CHARACTERS),
        ('', ''),
    ],
)
def test_a_text_of_others_is_one_printable_line(text: str, line: str) -> None:
    assert in_one_line(text) == line


@pytest.mark.parametrize('n_characters', [MOST_CHARACTERS + 1, 10 * MOST_CHARACTERS, 10**6])
def test_a_long_text_is_cut(n_characters: int) -> None:
    line = in_one_line('x' * n_characters)
    assert len(line) == MOST_CHARACTERS
    assert line.endswith('x...')


def test_what_repeats_itself_is_counted_and_not_logged() -> None:
    incidents = Incidents()
    assert incidents.note('refused', 'a', 0.0) == 'a'
    assert incidents.note('refused', 'a', 1.0) is None
    assert incidents.summary() == [('refused', '2'), ('latest incident 1', 'a')]


def test_a_flood_is_logged_in_part_and_counted_in_full() -> None:
    incidents = Incidents()
    lines = [incidents.note('refused', str(number), 0.001 * number) for number in range(5000)]
    n_logged = sum(line is not None for line in lines)
    assert 10 <= n_logged <= 100
    assert incidents.counts['refused'] == 5000
    assert incidents.note('other', 'first of its kind', 5.0) == 'first of its kind'
    later = incidents.note('refused', 'later', 100.0)
    assert later == f'later (and {5000 - n_logged} more: refused)'
