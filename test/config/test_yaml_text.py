"""What YAML text is read, what is refused in one line, and at which limits."""

import pytest
from uav_collect.config.yaml_text import dump, MAX_BYTES, read_value
from uav_collect.errors import ConfigError
from uav_collect.limits import (
    MAX_NO_FLY_CORNERS,
    MAX_SENSOR_ID,
    MAX_SENSORS,
    MAX_UAVS,
)
from uav_collect.scenario.load import load, with_uavs

PLAIN = (
    ('5', 5), ('-0', 0), ('+7', 7), ('1.5', 1.5), ('.5', 0.5), ('1e-3', 1e-3), ('2.E+6', 2e6),
    ('.inf', float('inf')), ('-.Inf', float('-inf')), ('yes', True), ('Off', False), ('~', None),
    ('null', None), ("'5'", '5'), ('"yes"', 'yes'), ('{a: [1, {b: }]}', {'a': [1, {'b': None}]}),
    ('&x [1]', [1]), ('[&x 1, *x, *x]', [1, 1, 1]), ('', None),
)  # fmt: skip

# YAML 1.1 has values for these, which readers of YAML do not agree about.
TEXTS = (
    '0x1f', '0b11', '0o17', '017', '1_000', '1:30', '1:30.5', '2024-01-01', '2024-01-01 10:00:00',
    'y', '=', '1e', '.', '_', '<<',
)  # fmt: skip

REFUSED = (
    ('a: !!int ""', "1: a has the tag '!!int': must be without tags, as !!int or !name"),
    ('a: !!bool x', "1: a has the tag '!!bool'"),
    ('a:\n- 1\n- !!float _', "3: a.1 has the tag '!!float'"),
    ('a: !!timestamp x', "1: a has the tag '!!timestamp'"),
    ('a: !!binary "?"', "1: a has the tag '!!binary'"),
    ('a: !!set {b}', "1: a has the tag '!!set'"),
    ('a: !!omap [b]', "1: a has the tag '!!omap'"),
    ('a: !!pairs [b]', "1: a has the tag '!!pairs'"),
    ('a: !!map [1]', "1: a has the tag '!!map'"),
    ('a: !!python/name:os.system', "1: a has the tag '!!python/name:os.system'"),
    ('a: ! b', "1: a has the tag '!'"),
    ('a: !mine b', "1: a has the tag '!mine'"),
    ('b: &b {c: 1}\na: {<<: *b}', '2: a has the key <<: must be without merge keys'),
    ('a: &a [*a]', "1: a.0 is not valid YAML: the alias 'a' stands for itself"),
    ('a: &a {b: {c: *a}}', "1: a.b.c is not valid YAML: the alias 'a' stands for itself"),
    ('a: *b', "1: a is not valid YAML: the alias 'b' has no anchor before it"),
    ('{a: 1, b: {c: 1, c: 2}}', "1: b is not valid YAML: the key 'c' appears twice"),
    ('{1: a, 1.0: b}', '1: is not valid YAML: the key 1.0 appears twice'),
    ('? [a]\n: b', '1: has a key that is a list or a mapping: must be text'),
    ('a: &a [b]\n*a : c', '2: has a key that is a list or a mapping: must be text'),
    ('--- a\n--- b', '2: is not valid YAML: expected a single document in the stream'),
    ('a: \x07', '1: is not valid YAML: the character U+0007 is not allowed'),
    ('%YAML 9.1\n--- a', '1: is not valid YAML: found incompatible YAML document'),
)  # fmt: skip

TOO_LARGE = {
    'has 16,777,217 characters: must have at most 16,777,216': 'a' * 16_777_217,
    'is nested too deep: must be at most 50 levels': '[' * 51,
    'nested blocks': '- ' * 100_000,
    'must have at most 520,000 values': f'[{"1," * 520_001}]',
    'must have at most 1,000 aliases': f'[&a 1{", *a" * 1_001}]',
    'must have at most 1,000 keys': '\n'.join(f'k{number}: 1' for number in range(1_001)),
    'has 1,001 digits: must have at most 1,000': '1' * 1_001,
    'has 5,002 digits: must have at most 1,000': f'a: 0.{"1" * 5_000}',
}


def value_of(text: str) -> object:
    value, _ = read_value(text, 'x.yaml')
    return value


@pytest.mark.parametrize(('text', 'value'), PLAIN)
def test_plain_values_are_read(text: str, value: object) -> None:
    assert value_of(text) == value
    assert type(value_of(text)) is type(value)


@pytest.mark.parametrize('text', TEXTS)
def test_what_readers_of_yaml_do_not_agree_about_is_text(text: str) -> None:
    assert value_of(f'[{text}]') == [text]


@pytest.mark.parametrize(('text', 'problem'), REFUSED)
def test_what_is_more_than_plain_values_is_one_line(text: str, problem: str) -> None:
    with pytest.raises(ConfigError) as caught:
        value_of(text)
    (line,) = caught.value.problems
    assert line.startswith(f'x.yaml:{problem}')
    assert '\n' not in line


@pytest.mark.parametrize(('problem', 'text'), TOO_LARGE.items(), ids=TOO_LARGE)
def test_what_is_too_large_is_refused_at_its_limit(problem: str, text: str) -> None:
    with pytest.raises(ConfigError) as caught:
        value_of(text)
    (line,) = caught.value.problems
    assert (problem if problem.startswith(('has', 'is', 'must')) else 'nested') in line
    assert len(line) < 300


def test_the_largest_scenario_that_may_be_is_read() -> None:
    odd = 1e5 / 3.0  # with as many digits as a number has
    sensor = {'id': '\U00020000' * MAX_SENSOR_ID, 'x_m': odd, 'y_m': odd, 'data_mbit': odd}
    zone = ((odd, odd),) * 25
    fault = {'uav': 64, 'kind': 'silent', 'at_s': (odd, odd), 'share': odd}
    one = {'sensors': [sensor], 'no_fly': [zone], 'faults': [fault]}
    n_each = {'sensors': MAX_SENSORS, 'no_fly': MAX_NO_FLY_CORNERS // 25, 'faults': 1_000}
    text = with_uavs(load('paper_10x10'), MAX_UAVS).to_yaml()
    text += dump({'boundary': ((odd, odd),) * 1_000})
    for key, entries in one.items():
        head, entry = dump({f'more_{key}': entries}).split('\n', 1)
        text += f'{head}\n{entry * n_each[key]}'
    assert len(text.encode()) < MAX_BYTES
    value, _ = read_value(text, 'large.yaml')
    assert {key: len(value[f'more_{key}']) for key in one} == n_each


def test_aliases_count_as_what_they_stand_for() -> None:
    tens = '\n'.join(f'x{n}: &x{n} [{", ".join([f"*x{n - 1}"] * 10)}]' for n in range(1, 9))
    with pytest.raises(ConfigError, match=r'x\.yaml:6: x5\.\d is too large'):
        value_of(f'x0: &x0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n{tens}')


def test_each_value_has_its_line() -> None:
    text = 'a:\n  b: 1\n  c:\n  - 2\n  - {d: 3,\n     e: &e {f: 4}}\ng: *e\n'
    _, place = read_value(text, '')
    a, g = place.below['a'], place.below['g']
    assert (a.line, a.below['b'].line, a.below['c'].line) == (1, 2, 3)
    first, second = a.below['c'].below.values()
    assert (first.line, second.line, second.below['d'].line) == (4, 5, 5)
    assert second.below['e'].line == 6
    assert (g.line, g.below['f'].line) == (7, 6)
