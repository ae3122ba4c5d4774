"""When an agent gets ready for a scenario, in whichever order it hears of them."""

from uav_collect.lockstep.flown_scenario import FlownScenario


def flying(world: str, fingerprint: str) -> FlownScenario:
    flown = FlownScenario()
    assert flown.is_news(world, fingerprint)
    assert flown.take(world, fingerprint)
    return flown


def test_what_a_world_says_again_is_no_news() -> None:
    flown = flying('w', 'A')
    assert not flown.is_news('w', 'A')
    assert not flown.take('w', 'A')  # it was asked twice


def test_another_scenario_or_world_is_news() -> None:
    flown = flying('w', 'A')
    assert flown.is_news('w', 'B')
    assert flown.take('w', 'B')
    assert flown.is_news('v', 'B')
    assert flown.take('v', 'B')


def test_a_scenario_that_returns_is_flown_anew_if_the_other_one_was_gone_when_it_was_asked() -> (
    None
):
    flown = flying('w', 'A')
    assert flown.is_news('w', 'B')  # nobody vouches for it any more
    assert flown.is_news('w', 'A')
    assert flown.take('w', 'A')
    assert not flown.is_news('w', 'A')


def test_a_scenario_that_returns_before_the_other_one_is_vouched_for_is_flown_in_the_end() -> None:
    flown = flying('w', 'A')
    assert flown.is_news('w', 'B')
    assert flown.is_news('w', 'A')
    assert flown.take('w', 'B')
    assert flown.take('w', 'A')
    assert not flown.is_news('w', 'A')


def test_what_another_world_says_leaves_the_own_one_as_it_is() -> None:
    flown = flying('w', 'A')
    assert flown.is_news('v', 'B')  # a later one, or a recording
    assert not flown.is_news('w', 'A')
