"""Names in tables: short where they can be, and never alike."""

from hypothesis import given
from hypothesis import strategies as st
import pytest
from uav_collect.analysis.short_names import short_names

RUNS = [
    f'runs/2026-11-30_12-00-00_lillgrund_aqmix/seed_{seed}/policy.safetensors' for seed in (1, 12)
]
WIDTHS = range(4, 201)


def shown(names: list[str], columns: int) -> list[str]:
    return [*short_names(names, columns).values()]


def test_names_that_fit_stand_as_they_are() -> None:
    names = ['sweep', 'hert', 'a_module:its_policy']
    assert shown(names, 20) == names


def test_what_paths_have_in_common_is_left_out() -> None:
    narrow = ['sweep', '...seed_1/policy....', '...seed_12/...']
    assert shown(['sweep', *RUNS], 20) == narrow
    wider = ['sweep', '...seed_1/policy.safetensors', '...seed_12/policy.safetensors']
    assert shown(['sweep', *RUNS], 32) == wider
    assert shown(['sweep', *RUNS], 200) == ['sweep', *RUNS]


@pytest.mark.parametrize('columns', [20, 30, 80])
def test_a_name_is_never_cut_where_it_differs_in_the_middle(columns: int) -> None:
    ends = [f'{size}_with_a_long_tail_{kind}_to_end' for size in (8, 10) for kind in 'ab']
    names = [f'study_of_fields_{end}' for end in ends]
    found = shown(names, columns)
    assert len({*found}) == 4
    for name, short in zip(names, found, strict=True):
        size, kind = name.split('_')[3], name.split('_')[8]
        assert f'{size}_' in short
        assert f'{kind}_' in short


def test_what_is_left_could_be_no_other_name() -> None:
    names = ['hert, exact', 'paper_15x15_n2_aqmix, exact', 'paper_15x15_n2_aqmix, equal']
    assert shown(names, 16) == ['hert, exact', '...aqmix, exact', '...aqmix, equal']
    assert shown(names, 12)[1:] == ['...aqmix, exact', '...equal']  # never '...exact'


def test_where_nothing_is_in_common_nothing_is_left_out() -> None:
    names = ['one' * 20, 'two' * 20]
    assert shown(names, 20) == names


def test_a_name_that_begins_as_another_one_ends_keeps_its_end() -> None:
    names = ['a_module_of_mine:policy', 'a_module_of_mine:policy_b']
    first, second = shown(names, 20)
    assert first.endswith('policy')
    assert second.endswith('policy_b')


def test_a_name_alone_is_whole_up_to_the_longest_that_may_be() -> None:
    assert shown(['n' * 64], 20) == ['n' * 64]
    assert shown(['n' * 65], 20) == ['n' * 61 + '...']


def test_names_that_differ_beyond_all_reading_are_numbered() -> None:
    first, second = shown(['n' * 900 + 'a', 'n' * 900 + 'b'], 40)
    assert first != second


def test_a_name_steers_no_terminal() -> None:
    assert shown(['\x1b[2J', 'sweep'], 20) == ['\\x1b[2J', 'sweep']


NAMES = st.lists(
    st.text('ab_/:. 12', min_size=1, max_size=40), min_size=1, max_size=6, unique=True
)


@given(NAMES, st.sampled_from(WIDTHS))
def test_no_two_names_are_shown_alike_unless_they_read_alike(
    names: list[str], columns: int
) -> None:
    found = short_names(names, columns)
    assert {*found} == {*names}
    assert len({*found.values()}) == len(names)
