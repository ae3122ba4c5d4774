"""Flies missions side by side, as kernels; `fly_on` is what happens when a UAV decides.

Rules choose inside the kernels. Whoever else flies, a network, a user's function or a learner, is
asked from outside: a mission then waits, and `fly_batch` carries it on once it is answered.
"""

from typing import NamedTuple

from uav_collect.kernels.arrays import Row
from uav_collect.kernels.compile import kernel, long_kernel
from uav_collect.kernels.handle import Handle
from uav_collect.missions.event_log import EventLog
from uav_collect.missions.experience import record, Records
from uav_collect.uav.action_codes import (
    BY_POLICY,
    ENERGY_RESERVE,
    FAULT,
    HOME,
    HOVER,
    N_ACTIONS,
    NONE,
)
from uav_collect.uav.agent import (
    allocate,
    guarded,
    reason_to_go_home,
    Workspace,
)
from uav_collect.uav.belief import belief_of, Beliefs, hear, observe
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.exploration import explore
from uav_collect.uav.heuristics import choose
from uav_collect.uav.moves import Moves
from uav_collect.uav.observation import encode
from uav_collect.uav.sharing import Shares
from uav_collect.uav.view import LocalView, ViewRows
from uav_collect.world import exchange
from uav_collect.world.dynamics import (
    contacts,
    end_s,
    GONE,
    has_but_its_reserve,
    has_fault,
    look,
    mission_of,
    Missions,
    next_uav,
    place_at,
    start_action,
    wait_for_the_slowest,
)
from uav_collect.world.faults import (
    Faults,
    note_faults,
    slow_down,
)
from uav_collect.world.reward import (
    earn,
    earn_interval,
    Earnings,
    energy_reward,
    news_reward,
    paper_reward,
    Reward,
    RewardTerms,
    start_earning,
)
from uav_collect.world.sensor_field import SensorField

IN_FLIGHT = -2  # a mission that waits for nobody and is not over: it is to be flown on
_PAPER = int(Reward.PAPER)
_ENERGY = int(Reward.ENERGY)


class Settings(NamedTuple):
    """How missions are flown; NONE (-1) stands for what is not wanted."""

    rule: int  # who decides; NONE: somebody outside is asked
    allocator: int
    layout: int = NONE  # of the observations that whoever is asked gets
    adviser: int = NONE  # a rule whose advice whoever is asked gets, and which flies UAVs home
    reward: int = NONE
    is_synchronous: int = 0  # UAVs wait for each other and decide at the same instants
    is_logged: int = 0
    n_rows: int = 0  # decisions of a mission that there is room to record
    guard_after: int = NONE  # decisions without news after which a guard decides; 0: never


class Waiting(NamedTuple):
    """What each mission waits for; kernels write it."""

    uav: Row[int]  # (W,) whose decision; NONE once the mission is over, or IN_FLIGHT
    time_s: Row[float]  # (W,)
    duration_s: Row[float]  # (W,) since the decision before
    reward: Row[float]  # (W,) the same
    legal: Row[Row[int]]  # (W, N_ACTIONS)
    advice: Row[int]  # (W,) what the adviser would do, by the compass; NONE without one
    observation: Row[Row[float]]  # (W, observation_size)
    heard: Row[int]  # (W,) UAVs that the deciding one heard, as bits
    n_records: Row[int]  # (W,)


class Batch(NamedTuple):
    """Missions side by side, and all that kernels need to fly them."""

    settings: Settings
    briefing: Briefing
    sensor_field: SensorField
    terms: RewardTerms  # of rewards
    missions: Missions
    link: exchange.Link  # between UAVs
    airwaves: exchange.FleetAirwaves  # where that is not ideal
    faults: Faults
    may_fail: int  # 1: there are some, or some have been injected
    beliefs: Beliefs  # by mission, then UAV: (W * U, ...)
    shares: Shares  # what the rule that decides or advises knows of the fleet's ways
    moves: Moves  # scratch to find ways
    memory: Row[Row[int]]  # of the rules, the same
    watch: Row[Row[int]]  # of the guards, the same
    complete: Row[Row[int]]  # (W, C) the union of the UAVs' maps, where news are rewarded
    n_events: Row[int]  # (W,)
    earnings: Earnings
    waiting: Waiting
    log: EventLog
    records: Records
    workspace: Workspace  # scratch of the UAV that decides
    view_rows: ViewRows  # the same


@long_kernel
def fly_batch(held: Handle[Batch], answers: Row[int]) -> int:
    """Fly every mission on: until it waits, is over, or the log has no more room.

    Args:
        held: the missions.
        answers: the action for each mission that waits; NONE lets it wait on. Shape (W,).

    Returns:
        How many missions are still in flight, for want of room.
    """
    batch, n_in_flight = held.rows, 0
    for world in range(len(answers)):
        uav = batch.waiting.uav[world]
        if uav != IN_FLIGHT and answers[world] == NONE:
            continue
        if uav == NONE:
            batch.waiting.duration_s[world] = 0.0
            batch.waiting.reward[world] = 0.0
            continue
        if uav != IN_FLIGHT:
            answer(batch, world, uav, answers[world])
        fly_on(batch, world)
        if batch.waiting.uav[world] == IN_FLIGHT:
            n_in_flight += 1
    return n_in_flight


KERNELS = (fly_batch,)  # that Python calls to fly missions


@kernel
def explore_all(
    held: Handle[Batch],
    epsilon: float,
    hover_share: float,
    advice_share: float,
    actions: Row[int],
) -> None:
    """Write the random action of each mission's decision; NONE stays where nobody explores."""
    batch, shares = held.rows, (epsilon, hover_share, advice_share)
    for world in range(len(actions)):
        uav = batch.waiting.uav[world]
        if uav != NONE:
            mission = mission_of(batch.missions, world)
            of = mission.seed[0], uav, mission.n_decisions[uav]
            advice, legal = batch.waiting.advice[world], batch.waiting.legal[world]
            actions[world] = explore(*of, *shares, advice, legal)


@kernel
def fly_on(batch: Batch, world: int) -> None:
    """Fly a mission on; each round of the loop is a UAV whose action ends, and what it does then.

    It hears the others, looks and is heard, shares its bandwidth, must go home or chooses, and
    starts its next action. Where an adviser would fly home nobody else is asked. What all UAVs
    earned since the event before is added up first.
    """
    settings, briefing, mission = batch.settings, batch.briefing, mission_of(batch.missions, world)
    batch.waiting.uav[world] = IN_FLIGHT
    while batch.n_events[world] < len(batch.log.event[world]) or settings.is_logged == 0:
        if settings.is_synchronous == 1:
            wait_for_the_slowest(briefing, mission)
        uav = next_uav(mission)
        end_interval(batch, world, mission.leg_end_s[uav] if uav >= 0 else end_s(mission))
        if uav < 0:
            _ask_nobody(batch, world)
            return
        place = world * briefing.n_uavs + uav
        belief, time_s = belief_of(batch.beliefs, place), mission.leg_end_s[uav]
        if batch.may_fail == 1:
            note_faults(mission, uav, time_s, batch.n_events[world])
        heard = listen(batch, world, uav, time_s)
        view = look(briefing, batch.sensor_field, mission, uav, batch.view_rows)
        if has_fault(mission, GONE, uav, time_s):
            carry_out(batch, world, uav, view, HOME, FAULT, heard)
            continue
        hear_all(batch, world, uav, heard, time_s)
        observe(belief, briefing, view)
        be_heard(batch, world, uav, heard, time_s)
        if settings.reward == _ENERGY:
            news = news_reward(belief.complete, batch.complete[world])
            earn(batch.earnings, world, batch.terms, news)
        hover_s = allocate(settings.allocator, briefing, view, batch.workspace)
        legal, action = batch.workspace.legal, HOME
        reason = reason_to_go_home(briefing, uav, belief.n_complete[0], view, hover_s, legal)
        if settings.is_synchronous == 1 and reason == NONE:
            reason = ENERGY_RESERVE if has_but_its_reserve(briefing, mission, uav) else NONE
        if reason == NONE:
            reason, action = BY_POLICY, NONE
            rule = settings.adviser if settings.rule == NONE else settings.rule
            if rule != NONE:
                ways, memory = (batch.shares, batch.moves), batch.memory[place]
                action = choose(rule, briefing, *ways, uav, belief, view, legal, memory)
            if settings.rule == NONE and action != HOME:
                _ask(batch, world, uav, view, heard, action)
                return
        carry_out(batch, world, uav, view, action, reason, heard)


@kernel
def answer(batch: Batch, world: int, uav: int, chosen: int) -> None:
    """Carry out what was chosen for the UAV that a mission waits for, unless its guard decides."""
    mission, waiting = mission_of(batch.missions, world), batch.waiting
    # A second look shows the same channels as the first.
    view = look(batch.briefing, batch.sensor_field, mission, uav, batch.view_rows)
    place = world * batch.briefing.n_uavs + uav
    action, reason = guarded(
        batch.settings.guard_after,
        batch.briefing,
        belief_of(batch.beliefs, place),
        view,
        waiting.legal[world],
        chosen,
        batch.watch[place],
        batch.moves,
    )
    if action == HOVER:
        allocate(batch.settings.allocator, batch.briefing, view, batch.workspace)
    if waiting.n_records[world] > 0:
        row = world * batch.settings.n_rows + waiting.n_records[world] - 1
        batch.records.action[row] = action
    carry_out(batch, world, uav, view, action, reason, waiting.heard[world])


@kernel
def listen(batch: Batch, world: int, uav: int, time_s: float) -> int:
    """The UAVs that the deciding one hears, as bits; a radio that is not ideal has heard them."""
    briefing, mission = batch.briefing, mission_of(batch.missions, world)
    if batch.link.is_ideal == 1:
        return contacts(briefing, mission, uav, time_s)
    airwaves, first = exchange.airwaves_of(batch.airwaves, world), world * briefing.n_uavs
    return exchange.meet(
        batch.link, briefing, mission, airwaves, batch.beliefs, first, uav, time_s
    )


@kernel
def hear_all(batch: Batch, world: int, uav: int, heard: int, time_s: float) -> None:
    """The deciding UAV hears where the others are, and their maps."""
    if batch.link.is_ideal == 0:
        return
    mission, first = mission_of(batch.missions, world), world * batch.briefing.n_uavs
    belief = belief_of(batch.beliefs, first + uav)
    for other in range(batch.briefing.n_uavs):
        if heard >> other & 1:
            x_m, y_m = place_at(batch.briefing, mission, other, time_s)
            hear(belief, other, batch.beliefs.complete[first + other], x_m, y_m, time_s)


@kernel
def be_heard(batch: Batch, world: int, uav: int, heard: int, time_s: float) -> None:
    """The others hear where the deciding UAV is, and its map."""
    mission, first = mission_of(batch.missions, world), world * batch.briefing.n_uavs
    if batch.link.is_ideal == 0:
        airwaves, belief = (
            exchange.airwaves_of(batch.airwaves, world),
            belief_of(batch.beliefs, first + uav),
        )
        exchange.speak(batch.link, batch.briefing, mission, airwaves, belief, uav, time_s)
        return
    complete = batch.beliefs.complete[first + uav]
    x_m, y_m = place_at(batch.briefing, mission, uav, time_s)
    for other in range(batch.briefing.n_uavs):
        if heard >> other & 1:
            hear(belief_of(batch.beliefs, first + other), uav, complete, x_m, y_m, time_s)


@kernel
def carry_out(
    batch: Batch, world: int, uav: int, view: LocalView, action: int, reason: int, heard: int
) -> None:
    """Start the deciding UAV's action, with the bandwidth shares of the workspace, and log it."""
    mission = mission_of(batch.missions, world)
    bit = start_action(batch.briefing, mission, uav, view, action, batch.workspace.share_hz)
    if batch.may_fail == 1:
        slow_down(batch.briefing, mission, uav)
    if batch.settings.is_logged == 1:
        _log_event(batch, world, uav, view, reason, bit, heard)
    batch.n_events[world] += 1


@kernel
def end_interval(batch: Batch, world: int, stop_s: float) -> None:
    """Log the interval since the latest event, and what all UAVs earned in it."""
    last = batch.n_events[world] - 1
    if last < 0:
        return
    settings, briefing, terms = batch.settings, batch.briefing, batch.terms
    mission, start_s = mission_of(batch.missions, world), batch.earnings.until_s[world]
    reward = 0.0
    if settings.is_logged == 1 or settings.reward == _PAPER:
        reward = paper_reward(briefing, terms, mission, start_s, stop_s)
    if settings.is_logged == 1:
        batch.log.interval_s[world][last] = stop_s - start_s
        batch.log.reward[world][last] = reward
    if settings.reward == _ENERGY:
        reward = energy_reward(briefing, terms, mission, start_s, stop_s)
    earn_interval(batch.earnings, world, terms, reward, stop_s)


@kernel
def _ask(batch: Batch, world: int, uav: int, view: LocalView, heard: int, advice: int) -> None:
    """Let a mission wait for a UAV's decision, and record what it is decided on."""
    waiting, settings, briefing = batch.waiting, batch.settings, batch.briefing
    _settle(batch, world)
    waiting.uav[world] = uav
    waiting.heard[world] = heard
    waiting.advice[world] = advice
    for action in range(N_ACTIONS):
        waiting.legal[world][action] = batch.workspace.legal[action]
    first = world * briefing.n_uavs
    if settings.layout != NONE:
        belief, out = belief_of(batch.beliefs, first + uav), waiting.observation[world]
        encode(settings.layout, briefing, batch.shares, uav, belief, view, advice, out)
    if waiting.n_records[world] < settings.n_rows:
        row = world * settings.n_rows + waiting.n_records[world]
        mission, legal = mission_of(batch.missions, world), batch.workspace.legal
        record(batch.records, row, briefing, mission, batch.beliefs, first, uav, view, legal)
        waiting.n_records[world] += 1


@kernel
def _ask_nobody(batch: Batch, world: int) -> None:
    """Let a mission be over."""
    _settle(batch, world)
    batch.waiting.uav[world] = NONE
    for action in range(N_ACTIONS):
        batch.waiting.legal[world][action] = 0


@kernel
def _settle(batch: Batch, world: int) -> None:
    """Give the decision before what was earned since."""
    waiting, earnings = batch.waiting, batch.earnings
    waiting.time_s[world] = earnings.until_s[world]
    waiting.duration_s[world] = earnings.until_s[world] - earnings.since_s[world]
    waiting.reward[world] = earnings.reward[world]
    if waiting.n_records[world] > 0:
        row = world * batch.settings.n_rows + waiting.n_records[world] - 1
        batch.records.reward[row] = waiting.reward[world]
        batch.records.duration_s[row] = waiting.duration_s[world]
    start_earning(earnings, world, earnings.until_s[world])


@kernel
def _log_event(
    batch: Batch, world: int, uav: int, view: LocalView, reason: int, bit: float, heard: int
) -> None:
    """Log an event right after the deciding UAV's action started."""
    log, index = batch.log, batch.n_events[world]
    mission = mission_of(batch.missions, world)
    started = 0 if mission.action[uav] == HOME else 1
    log.event[world][index] = index
    log.time_s[world][index] = view.time_s
    log.uav[world][index] = uav + 1
    log.decision[world][index] = mission.n_decisions[uav] - started
    log.x_m[world][index] = view.x_m
    log.y_m[world][index] = view.y_m
    log.action[world][index] = mission.action[uav]
    log.reason[world][index] = reason
    log.duration_s[world][index] = mission.duration_s[uav]
    log.energy_left_j[world][index] = view.energy_left_j
    log.energy_j[world][index] = mission.energy_j[uav]
    log.collected_bit[world][index] = bit
    log.n_sensors[world][index] = view.n_sensors if bit > 0.0 else 0
    log.heard[world][index] = heard
    place = world * batch.briefing.n_uavs + uav
    log.known_complete[world][index] = batch.beliefs.n_complete[place][0]
