"""The courses that a policy learns on at a time, drawn anew after a while, with turns by need."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from uav_collect.errors import ConfigError
from uav_collect.learning.minibatch import Algorithm
from uav_collect.learning.random_state import restore_rng, rng_state
from uav_collect.learning.saved import SavedPart
from uav_collect.learning.task import (
    check_algorithm,
    check_room,
    new_collector,
    new_task,
    restore_tasks,
    states_of,
    Task,
)
from uav_collect.learning.teaching import teaching
from uav_collect.scenario.site import build_site
from uav_collect.training.config import CourseSettings, TrainingConfig
from uav_collect.training.course_draw import draw_course
from uav_collect.training.courses import CourseDistribution
from uav_collect.uav.action_codes import NONE
from uav_collect.uav.observation import Layout

_TURNS_KEY = 3  # of the run's seed: whose turn it is
_SURPASSING = 1.03  # times what the sweep has; two means of its own missions differ by less


@dataclass
class _Course:
    """A course that is learned on."""

    number: int  # in the order of being drawn
    task: Task
    mark_kbit_per_j: float  # the efficiency to reach: of the sweep, or of a better teacher
    is_swept: bool  # that is the sweep's
    n_updates: int = 0  # so far, and turns at which there was nothing to learn
    lasts: int = field(default=0)  # so many until another one takes its place


class CourseTasks:
    """Tasks of drawn courses: so many at once, each for a number of updates.

    A course has turns in proportion to what is still to be learned on it: how far the missions
    flown last, which explore, stay below the sweep's efficiency, or a teacher's. None goes without
    turns.
    """

    def __init__(
        self,
        distribution: CourseDistribution,
        config: TrainingConfig,
        algorithm: Algorithm,
        seed: int,
        device: str,
    ) -> None:
        """Draw the first courses, and start their missions.

        Args:
            distribution: what they are drawn from.
            config: of the training, with its part `courses`.
            algorithm: how it learns.
            seed: of the run.
            device: of the network that flies.

        Raises:
            ConfigError: the settings are none for courses, or courses cannot be flown.
        """
        self._settings = check_settings(distribution, config, algorithm)
        check_algorithm(algorithm, config)  # before teachers fly for minutes
        self._distribution, self._config, self._algorithm = distribution, config, algorithm
        self._seed, self._device = seed, device
        self._rng = np.random.Generator(np.random.Philox(key=[seed, _TURNS_KEY]))
        self._n_left_decisions = self._n_left_missions = 0  # of courses that are no more held
        n_courses, lasts = self._settings.at_once, self._settings.updates_each
        # The first ones are left one after another: there are always old and new ones.
        self._courses = [
            self._new_course(number, -(-lasts * (number + 1) // n_courses))
            for number in range(n_courses)
        ]
        self._n_drawn = n_courses

    @property
    def tasks(self) -> tuple[Task, ...]:
        """Those of the courses that are learned on now."""
        return tuple(course.task for course in self._courses)

    @property
    def n_decisions(self) -> int:
        """How many decisions were collected so far, on courses that are left too."""
        return self._n_left_decisions + sum(task.source.n_decisions for task in self.tasks)

    @property
    def n_missions(self) -> int:
        """How many missions were collected so far, on courses that are left too."""
        return self._n_left_missions + sum(task.source.n_missions for task in self.tasks)

    @property
    def n_drawn(self) -> int:
        """How many courses have been drawn so far."""
        return self._n_drawn

    def next_turn(self) -> tuple[int, ...]:
        """The places of the courses whose turn it is: from these the next update learns."""
        needs = np.array([self._need(course) for course in self._courses])
        size = self._settings.per_update or 1
        drawn = self._rng.choice(len(needs), size, replace=False, p=needs / needs.sum())
        return tuple(drawn.tolist())

    def teaches(self, place: int) -> bool:
        """Whether there is something to learn on a course.

        Who imitates the sweep has nothing to learn from it where it is surpassed, by more than
        chance: who is about as good and not held to it forgets, and is the worse long before the
        latest missions tell.
        """
        course = self._courses[place]
        if self._algorithm is not Algorithm.IMITATION or not course.is_swept:
            return True
        recent = course.task.source.recent.efficiency_kbit_per_j
        return not recent >= _SURPASSING * course.mark_kbit_per_j  # true where nothing is known

    def count_update(self, place: int) -> None:
        """Note that a course had its turn; another one takes its place once it has lasted."""
        course = self._courses[place]
        course.n_updates += 1
        if course.n_updates < course.lasts:
            return
        self._n_left_decisions += course.task.source.n_decisions
        self._n_left_missions += course.task.source.n_missions
        self._courses[place] = self._new_course(self._n_drawn, self._settings.updates_each)
        self._n_drawn += 1

    def state(self) -> dict[str, Any]:
        """All that they need to go on; the inverse is `restore`."""
        courses = [
            {'number': it.number, 'n_updates': it.n_updates, 'lasts': it.lasts}
            for it in self._courses
        ]
        return {
            **states_of(self.tasks),
            'courses': courses,
            'turns': rng_state(self._rng),
            'n_drawn': self._n_drawn,
            'n_left_decisions': self._n_left_decisions,
            'n_left_missions': self._n_left_missions,
        }

    def restore(self, saved: SavedPart) -> None:
        """Go on from the state of tasks of the same run.

        Raises:
            CheckpointError: something that was saved is not what such tasks save.
        """
        self._n_drawn = saved.whole('n_drawn', low=len(self._courses))
        parts = saved.parts('courses', len(self._courses))
        for place, part in enumerate(parts):
            number = part.whole('number', high=self._n_drawn - 1)
            lasts = part.whole('lasts', low=1)
            if self._courses[place].number != number:
                self._courses[place] = self._new_course(number, lasts)
            self._courses[place].lasts = lasts
            self._courses[place].n_updates = part.whole('n_updates', high=lasts - 1)
        restore_tasks(self.tasks, saved)
        restore_rng(self._rng, saved.part('turns'))
        self._n_left_decisions = saved.whole('n_left_decisions')
        self._n_left_missions = saved.whole('n_left_missions')

    def _need(self, course: _Course) -> float:
        """How much there is still to be learned on a course, up to 1."""
        recent = course.task.source.recent.efficiency_kbit_per_j
        if np.isnan(recent) or course.mark_kbit_per_j <= 0.0:
            return 1.0
        missing = 1.0 - recent / course.mark_kbit_per_j
        return min(max(missing, self._settings.least_need), 1.0)

    def _new_course(self, number: int, lasts: int) -> _Course:
        config = self._config
        site = build_site(draw_course(self._distribution, self._seed, number))
        taught = teaching(site, config, self._algorithm, self._seed, number)
        source = new_collector(
            site, config, self._algorithm, self._seed, self._device, number, taught.policy
        )
        return _Course(
            number=number,
            task=new_task(site, source, config, self._settings.at_once),
            mark_kbit_per_j=taught.kbit_per_j,
            is_swept=taught.policy is None,
            lasts=lasts,
        )


def check_settings(
    distribution: CourseDistribution, config: TrainingConfig, algorithm: Algorithm
) -> CourseSettings:
    """The settings of courses, if a policy can learn on them by these.

    Raises:
        ConfigError: one line that says which setting to change.
    """
    settings = config.courses
    if settings is None:
        raise ConfigError(
            f'preset {config.name}: courses is missing: must be there to learn on courses, as the '
            'preset anywhere has it'
        )
    if config.layout.base is Layout.PAPER:
        raise ConfigError(
            f'observation is {config.observation!r}: must be one that no area changes, to learn on'
            ' courses'
        )
    if distribution.domains and config.layout.adviser == NONE:
        raise ConfigError(
            f'observation is {config.observation!r}: must be relative for courses with domains,'
            ' outside of which the adviser decides'
        )
    for place, domain in enumerate(distribution.domains or ()):
        if domain.network is not None:
            raise ConfigError(
                f'courses {distribution.name}: domains.{place}.network is {domain.network}: must'
                ' be absent: what learns is one network'
            )
    if algorithm.mixes and not config.mixer.is_of_sets:
        kind = config.mixer.kind or 'fleet'
        raise ConfigError(f'mixer.kind is {kind!r}: must be set to learn on courses')
    if (settings.per_update or 1) > settings.at_once:
        raise ConfigError(
            f'courses.per_update is {settings.per_update}: must be at most {settings.at_once}, the'
            ' courses at once'
        )
    most, n_uavs = config.layout.max_uavs, distribution.fleet.n_uavs
    if n_uavs[1] > most:
        raise ConfigError(
            f'courses {distribution.name}: fleet.n_uavs is {[*n_uavs]}: must end at {most} at'
            f' most, for which observation {config.observation!r} has room'
        )
    side = distribution.area.cells_per_side[1]
    check_room(config, side * side, settings.at_once)
    return settings
