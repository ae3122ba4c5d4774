"""An agent takes its messages in the order in which the world meant them."""

from copy import deepcopy
from operator import attrgetter
from types import SimpleNamespace
from typing import Any

from fleets import Pilots
import pytest
from tiny_world import tiny, uav
from uav_collect.lockstep.inbox import Inbox
from uav_collect.scenario.model import Scenario
from uav_collect.uav.action_codes import BY_POLICY, HOME
from uav_collect.uav.agent import Agent, allocator_named
from uav_collect.uav.briefing import brief
from uav_collect.uav.messages import Decision
from uav_collect.uav.policy import policy_named

WORLD = '0123456789abcdef'
N_EVENTS = 12


def mission(number: int) -> str:
    return f'{WORLD}-{number}'


def observation_of(mission_id: str, decision: int, **values: object) -> SimpleNamespace:
    """An observation as far as an inbox reads it."""
    about = {'n_radio_delivered': 0, 'terminated': False, 'view': None, **values}
    return SimpleNamespace(mission_id=mission_id, decision=decision, **about)


@pytest.fixture(scope='module')
def scenario() -> Scenario:
    return tiny(uav(5.0), uav(10.0))


class History:
    """What the first UAV hears and sees in the first events of a mission, and what it decides."""

    def __init__(self, scenario: Scenario, number: int = 0) -> None:
        self.observations: list[Any] = []
        self.decisions: list[Decision] = []
        pilots = Pilots(scenario, number, 'sweep')
        for _ in range(N_EVENTS):
            event = pilots.simulation.next_event()
            assert event is not None
            n_delivered, view = len(pilots.radio[0]) + len(event.heard), deepcopy(event.view)
            decision = pilots.decide(event)
            if event.uav == 0:
                self.observations.append(
                    observation_of(
                        mission(number), event.decision, n_radio_delivered=n_delivered, view=view
                    )
                )
                self.decisions.append(decision)
            pilots.simulation.start(event, decision)
        self.radio = [
            SimpleNamespace(mission_id=mission(number), delivery=delivery, message=message)
            for delivery, message in enumerate(pilots.radio[0], start=1)
        ]

    def answer(
        self, n_observations: int, *, pending: bool = False, number: int = 0
    ) -> SimpleNamespace:
        """What the world answers an agent that joins after so many observations."""
        observations = self.observations[:n_observations]
        n_delivered = observations[-1].n_radio_delivered if observations else 0
        return SimpleNamespace(
            mission_id=mission(number),
            observations=observations,
            radio=self.radio[:n_delivered],
            decision_pending=pending,
        )


@pytest.fixture(scope='module')
def history(scenario: Scenario) -> History:
    return History(scenario)


@pytest.fixture(scope='module')
def next_history(scenario: Scenario) -> History:
    return History(scenario, 1)


@pytest.fixture
def inbox(scenario: Scenario) -> Inbox:
    agent = Agent(brief(scenario), 0, policy_named('sweep'), allocator_named('exact'))
    return empty(agent)


def empty(agent: Agent, world: str = WORLD) -> Inbox:
    """Nothing has come yet."""
    return Inbox(agent, world, view_from=attrgetter('view'), radio_from=attrgetter('message'))


def decide(inbox: Inbox) -> list[Decision]:
    """The decisions that can be taken now."""
    decisions = []
    while (observation := inbox.next_observation()) is not None:
        decisions.append(inbox.agent.decide(inbox.deliver(observation)))
    return decisions


def test_the_history_of_these_tests_holds_radio_messages_before_and_between(
    history: History,
) -> None:
    delivered = [observation.n_radio_delivered for observation in history.observations]
    assert len(set(delivered)) > 2
    assert len(history.observations) > 2


def test_all_radio_messages_before_all_observations_and_the_other_way_round(
    history: History, inbox: Inbox
) -> None:
    for message in history.radio:
        inbox.add_radio(message)
    for observation in history.observations:
        inbox.add_observation(observation)
    assert decide(inbox) == history.decisions
    inbox = empty(inbox.agent)
    for observation in history.observations:
        inbox.add_observation(observation)
    for message in reversed(history.radio):
        inbox.add_radio(message)
    assert decide(inbox) == history.decisions


def test_an_observation_waits_for_every_radio_message_before_it(
    history: History, inbox: Inbox
) -> None:
    inbox.add_observation(history.observations[0])
    for message in history.radio[1 : history.observations[1].n_radio_delivered]:
        inbox.add_radio(message)
    inbox.add_observation(history.observations[1])
    waiting = decide(inbox)
    inbox.add_radio(history.radio[0])
    assert waiting == history.decisions[: len(waiting)]
    assert len(waiting) < 2
    assert waiting + decide(inbox) == history.decisions[:2]


def test_messages_heard_twice_count_once(history: History, inbox: Inbox) -> None:
    for _ in range(2):
        for message in history.radio:
            inbox.add_radio(message)
        for observation in history.observations:
            inbox.add_observation(observation)
        first = decide(inbox)
        assert first in (history.decisions, [])


@pytest.mark.parametrize('pending', [True, False])
def test_a_restarted_agent_goes_on_with_the_same_decisions(
    pending: bool, history: History, inbox: Inbox
) -> None:
    inbox.replay(history.answer(3, pending=pending))
    for message in history.radio:
        inbox.add_radio(message)
    decisions = decide(inbox)
    for observation in history.observations[3:]:
        assert inbox.add_observation(observation) is None
        decisions += decide(inbox)
    assert decisions == history.decisions[2 if pending else 3 :]


def test_an_observation_that_overtakes_the_history_is_not_lost(
    history: History, inbox: Inbox
) -> None:
    for message in history.radio:
        inbox.add_radio(message)
    for observation in history.observations:  # latched from the first on, and one more
        inbox.add_observation(observation)
    inbox.replay(history.answer(2))
    assert decide(inbox) == history.decisions[2:]


def test_a_mission_that_overtakes_the_history_of_the_one_before_is_flown(
    history: History, next_history: History, inbox: Inbox
) -> None:
    for message in next_history.radio:
        inbox.add_radio(message)
    for observation in next_history.observations:
        inbox.add_observation(observation)
    inbox.replay(history.answer(2))
    assert decide(inbox) == next_history.decisions


def test_the_next_mission_begins_with_its_first_observation(
    history: History, next_history: History, inbox: Inbox
) -> None:
    decisions = []
    for flown in (history, next_history, history):  # the last one is past, and ignored
        for message in flown.radio:
            inbox.add_radio(message)
        for observation in flown.observations:
            inbox.add_observation(observation)
        decisions += decide(inbox)
    assert decisions == history.decisions + next_history.decisions


def test_what_another_world_said_is_ignored(history: History, inbox: Inbox) -> None:
    stranger = empty(inbox.agent, 'fedcba9876543210')
    for message in history.radio:
        stranger.add_radio(message)
    for observation in history.observations:
        stranger.add_observation(observation)
    assert decide(stranger) == []


def test_a_mission_that_is_over_for_the_uav_asks_for_no_decision(
    history: History, inbox: Inbox
) -> None:
    inbox.add_observation(observation_of(mission(0), 0, terminated=True))
    assert decide(inbox) == []


def test_in_step_only_the_next_decision_is_kept(history: History, inbox: Inbox) -> None:
    inbox.replay(history.answer(1))
    for message in history.radio:
        inbox.add_radio(message)
    refusal = inbox.add_observation(observation_of(mission(0), 2))
    assert refusal == 'decision 2 does not come next, but decision 1'
    assert inbox.add_observation(history.observations[0]) is None  # late, as latched ones are
    assert inbox.add_observation(history.observations[1]) is None
    assert decide(inbox) == history.decisions[1:2]


@pytest.mark.parametrize('number', [1, 7, 10**9 - 1])
def test_a_mission_before_this_one_is_over_is_for_the_world_to_confirm(
    number: int, history: History, inbox: Inbox
) -> None:
    inbox.replay(history.answer(1))
    assert inbox.add_observation(observation_of(mission(number), 0)) is None
    assert inbox.doubts_mission
    inbox.replay(history.answer(1))  # the world says that the mission is what it was
    assert not inbox.doubts_mission
    for message in history.radio:
        inbox.add_radio(message)
    decisions = []
    for observation in history.observations[1:]:
        inbox.add_observation(observation)
        decisions += decide(inbox)
    assert decisions == history.decisions[1:]


def test_a_mission_that_the_world_confirms_is_flown(
    history: History, next_history: History, inbox: Inbox
) -> None:
    inbox.replay(history.answer(1))
    inbox.add_observation(next_history.observations[0])
    assert inbox.doubts_mission
    inbox.replay(next_history.answer(1, pending=True, number=1))
    for message in next_history.radio:
        inbox.add_radio(message)
    assert decide(inbox) == next_history.decisions[:1]


def test_the_mission_after_one_that_is_over_is_flown_at_once(
    history: History, next_history: History, inbox: Inbox
) -> None:
    inbox.replay(history.answer(1))
    inbox.note(Decision(action=HOME, reason=BY_POLICY))
    for message in next_history.radio:
        inbox.add_radio(message)
    inbox.add_observation(next_history.observations[0])
    assert not inbox.doubts_mission
    assert decide(inbox) == next_history.decisions[:1]


@pytest.mark.parametrize('number', ['9' * 5000, '-1000000000', '1' * 10, '²', '٣', ''])
def test_what_is_no_number_of_a_mission_is_ignored(
    number: str, history: History, inbox: Inbox
) -> None:
    inbox.replay(history.answer(1))
    wrong = f'{WORLD}-{number}'
    assert inbox.add_observation(observation_of(wrong, 0)) is None
    inbox.add_radio(SimpleNamespace(mission_id=wrong, delivery=1, message=None))
    assert not inbox.doubts_mission


def test_there_is_a_bound_on_what_waits(history: History, inbox: Inbox) -> None:
    inbox.replay(history.answer(1))
    for number in range(1, 1000):
        inbox.add_observation(observation_of(mission(number), 0))
        for delivery in (1, 10**6, 2**32 - 1):
            inbox.add_radio(
                SimpleNamespace(mission_id=mission(number), delivery=delivery, message=None)
            )
    kept = inbox._messages.values()  # memory shows nowhere else
    assert sum(len(each.observations) + len(each.radio) for each in kept) < 20


def test_what_did_not_count_is_decided_again(history: History, inbox: Inbox) -> None:
    inbox.replay(history.answer(1))
    for message in history.radio:
        inbox.add_radio(message)
    inbox.add_observation(history.observations[1])
    assert decide(inbox) == history.decisions[1:2]
    inbox.replay(history.answer(2, pending=True))
    assert decide(inbox) == []  # it was sent
    inbox.lose_step()
    inbox.replay(history.answer(2, pending=True))
    assert decide(inbox) == history.decisions[1:2]


def test_a_history_of_any_length_is_lived_through(history: History, inbox: Inbox) -> None:
    n_heard, first = 10_000, history.observations[0]
    about = {'mission_id': mission(0), 'message': history.radio[0].message}
    late = observation_of(mission(0), 0, n_radio_delivered=n_heard, view=first.view)
    inbox.replay(
        SimpleNamespace(
            mission_id=mission(0),
            observations=[late],
            radio=[SimpleNamespace(delivery=number + 1, **about) for number in range(n_heard)],
            decision_pending=True,
        )
    )
    assert len(decide(inbox)) == 1


def test_a_mission_that_the_world_does_not_know_is_left_when_it_says_so_twice(
    history: History, inbox: Inbox
) -> None:
    inbox.add_observation(observation_of(mission(999), 0))
    inbox.replay(history.answer(1))
    assert inbox.doubts_mission  # it may have begun since the world answered
    inbox.replay(history.answer(1))
    assert not inbox.doubts_mission
    for message in history.radio:
        inbox.add_radio(message)
    inbox.add_observation(history.observations[1])
    assert decide(inbox) == history.decisions[1:2]
