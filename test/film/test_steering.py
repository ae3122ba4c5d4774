"""What pages may ask, as JSON that anyone may have written."""

import json

import pytest
from uav_collect.errors import RefusedError
from uav_collect.film.steering import COMMANDS, MOST_BYTES, Wish, wish_of
from uav_collect.limits import MAX_SEED


@pytest.mark.parametrize('command', ['abort', 'pause', 'resume', 'step'])
def test_a_command_is_a_wish(command: str) -> None:
    assert command in COMMANDS
    assert wish_of(json.dumps({'command': command})) == Wish(command=command)


def test_a_start_has_a_seed_and_a_pace_a_number() -> None:
    assert wish_of('{"command": "start", "seed": 7}') == Wish(command='start', seed=7)
    assert wish_of('{"command": "pace", "pace": 2.5}') == Wish(command='pace', pace=2.5)
    assert wish_of('{"command": "pace", "pace": 0}').pace == 0.0


@pytest.mark.parametrize(
    ('text', 'why'),
    [
        ('', f'this is no object of JSON within {MOST_BYTES} bytes'),
        ('[1]', 'this is no object of JSON within'),
        ('[' * 900, 'this is no object of JSON within'),
        (json.dumps({'command': 'pause', 'x': 'y' * MOST_BYTES}), 'this is no object of JSON'),
        (b'\xff', 'this is no object of JSON within'),
        ('{}', 'command is None: must be start or abort or pause or resume or step or pace'),
        ('{"command": ["pause"]}', "command is \\['pause'\\]: must be"),
        ('{"command": "pause", "seed": 1}', 'seed is there: pause has none'),
        ('{"command": "start"}', f'seed is None: must be a whole number from 0 to {MAX_SEED}'),
        ('{"command": "start", "seed": -1}', 'seed is -1: must be a whole number'),
        ('{"command": "start", "seed": true}', 'seed is True: must be a whole number'),
        ('{"command": "start", "seed": 1.5}', 'seed is 1.5: must be a whole number'),
        ('{"command": "pace", "pace": NaN}', 'pace is nan: must be a number from 0 to 1000'),
        ('{"command": "pace", "pace": 1e9}', 'pace is 1000000000.0: must be a number'),
        ('{"command": "pace", "pace": "2"}', "pace is '2': must be a number"),
    ],
)
def test_all_else_is_refused_in_a_line(text: str | bytes, why: str) -> None:
    with pytest.raises(RefusedError, match=f'^{why}') as refused:
        wish_of(text)
    assert '\n' not in str(refused.value)
