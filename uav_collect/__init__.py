"""Fleets of UAVs that collect data from ground sensors: what there is for users of Python.

Missions:

- `fly(scenario, policy)` flies one: a `FlownMission` with `log`, `metrics` and `draw(file)`.
- `evaluate(scenario, policies, missions)` flies many: an `Evaluation` with means and intervals.
- `choose_policy(scenario, candidates)` finds the best policy for one, by simulation: a `Choice`.
- `bound(scenario)` plans one whose demand is known; what no flight gets beyond is beside it.
- `load(name_or_path)` reads a `Scenario`; `build_site` draws its sensors.
- `mission_metrics(log)` is what a mission achieved, from its log alone.

Policies of your own: a function of a `Situation` that returns `HOVER`, `FORWARD`, `RIGHT`,
`BACKWARD` or `LEFT`, whichever are legal, or `HOME`. `step_towards` finds the way to a cell.

Reinforcement learning: `env(scenario)` is a PettingZoo environment where UAVs decide one by one,
`parallel_env(scenario)` one where all decide at the same instants, and `WorldsEnv(scenario)` many
missions as a Gymnasium vector environment. `VectorEnv` steps many missions at once without either,
as its `VectorEnvConfig` says, with a `Layout` and a `Reward`.

Whatever a user may handle is a `UavCollectError`. Importing this package loads nothing else: each
name loads its module when it is used. What is not listed here is free to move.
"""

from importlib import import_module
from typing import Any, TYPE_CHECKING

from uav_collect.revision import VERSION

if TYPE_CHECKING:
    from uav_collect.analysis.choice import Choice
    from uav_collect.analysis.metrics import mission_metrics
    from uav_collect.analysis.results import Evaluation, FlownMission
    from uav_collect.api import bound, choose_policy, evaluate, fly
    from uav_collect.environments.aec import env
    from uav_collect.environments.parallel import parallel_env
    from uav_collect.environments.worlds import WorldsEnv
    from uav_collect.errors import UavCollectError
    from uav_collect.missions.vector_env import VectorEnv, VectorEnvConfig
    from uav_collect.scenario.load import load
    from uav_collect.scenario.model import Scenario
    from uav_collect.scenario.site import build_site
    from uav_collect.uav.action_codes import BACKWARD, FORWARD, HOME, HOVER, LEFT, RIGHT
    from uav_collect.uav.observation import Layout
    from uav_collect.uav.situation import Situation, step_towards
    from uav_collect.world.reward import Reward

__all__ = [
    'BACKWARD',
    'FORWARD',
    'HOME',
    'HOVER',
    'LEFT',
    'RIGHT',
    'Choice',
    'Evaluation',
    'FlownMission',
    'Layout',
    'Reward',
    'Scenario',
    'Situation',
    'UavCollectError',
    'VectorEnv',
    'VectorEnvConfig',
    'WorldsEnv',
    '__version__',
    'bound',
    'build_site',
    'choose_policy',
    'env',
    'evaluate',
    'fly',
    'load',
    'mission_metrics',
    'parallel_env',
    'step_towards',
]

__version__ = VERSION

_NAMES_OF = {
    'analysis.choice': ('Choice',),
    'analysis.metrics': ('mission_metrics',),
    'analysis.results': ('Evaluation', 'FlownMission'),
    'api': ('bound', 'choose_policy', 'evaluate', 'fly'),
    'environments.aec': ('env',),
    'environments.parallel': ('parallel_env',),
    'environments.worlds': ('WorldsEnv',),
    'errors': ('UavCollectError',),
    'missions.vector_env': ('VectorEnv', 'VectorEnvConfig'),
    'scenario.load': ('load',),
    'scenario.model': ('Scenario',),
    'scenario.site': ('build_site',),
    'uav.action_codes': ('BACKWARD', 'FORWARD', 'HOME', 'HOVER', 'LEFT', 'RIGHT'),
    'uav.observation': ('Layout',),
    'uav.situation': ('Situation', 'step_towards'),
    'world.reward': ('Reward',),
}
_MODULE_OF = {name: module for module, names in _NAMES_OF.items() for name in names}


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


if not TYPE_CHECKING:  # or else a checker would take any name for one of ours

    def __getattr__(name: str) -> Any:  # noqa: ANN401 - whatever the name stands for
        if name not in _MODULE_OF:
            raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
        value = getattr(import_module(f'{__name__}.{_MODULE_OF[name]}'), name)
        globals()[name] = value
        return value
