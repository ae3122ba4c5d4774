"""Every mission of a run is remembered, in the room of a few numbers."""

import random

from uav_collect.ingest.mission_ids import MissionIds


def ids_of(numbers: range | list[int], world: str = 'world') -> MissionIds:
    ids = MissionIds()
    for number in numbers:
        ids.add(f'{world}-{number}')
    return ids


def test_it_holds_what_was_added_in_any_order_and_nothing_else() -> None:
    rng = random.Random(0)
    for _ in range(200):
        numbers = [rng.randrange(30) for _ in range(rng.randrange(40))]
        ids = ids_of(numbers)
        assert [f'world-{number}' in ids for number in range(31)] == [
            number in numbers for number in range(31)
        ]
        assert len(ids) == len({*numbers})


def test_worlds_differ_whatever_their_names_are() -> None:
    ids = ids_of(range(5), 'a-1')
    assert 'a-1-4' in ids
    assert 'a-1-5' not in ids
    assert 'a-1' not in ids
    assert 'a-4' not in ids


def test_a_million_missions_of_one_world_take_two_numbers_and_gaps_two_more() -> None:
    ids = ids_of(range(1_000_000))
    assert ids.state() == {'world': [0, 1_000_000]}
    assert ids_of([*range(7), *range(8, 20)]).state() == {'world': [0, 7, 8, 20]}


def test_what_is_restored_holds_the_same_and_changes_by_itself() -> None:
    ids, other = ids_of([1, 2, 9]), MissionIds()
    other.restore(ids.state())
    other.add('world-3')
    assert len(ids) == 3
    assert other.state() == {'world': [1, 4, 9, 10]}
