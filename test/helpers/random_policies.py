"""Learned policies for tests: random weights, which fly far and wide but always the same way."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from uav_collect.kernels.arrays import Row
from uav_collect.uav.belief import Belief
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.observation import Layout, observation_size
from uav_collect.uav.policy import Policy
from uav_collect.uav.policy_file import load_policy, save_policy, WEIGHTS_FORMAT
from uav_collect.uav.policy_header import PolicyHeader, Validation, weight_shapes
from uav_collect.uav.policy_network import FrozenPolicy, Weights
from uav_collect.uav.tensor_file import read_head, tensor_file
from uav_collect.uav.view import LocalView

VALIDATION = Validation(
    efficiency_kbit_per_j=1.25,
    completion_s=250.0,
    energy_kj=70.0,
    collected_share=1.0,
    complete_share=0.99,
    safe_share=1.0,
    missions=100,
    bandwidth='equal',
)


@dataclass
class Behind:
    """A policy behind the protocol alone, so that it is flown agent by agent."""

    policy: Policy

    @property
    def name(self) -> str:
        return self.policy.name

    @property
    def version(self) -> str:
        return self.policy.version

    def begin(self, briefing: Briefing, uav: int) -> None:
        self.policy.begin(briefing, uav)

    def choose(self, belief: Belief, view: LocalView, legal: Row[int]) -> int:
        return self.policy.choose(belief, view, legal)


def header(
    layout: Layout = Layout.EGOCENTRIC, side: int = 10, n_uavs: int = 2, **values: object
) -> PolicyHeader:
    """The header of a policy for one area and fleet, or with other values."""
    made = PolicyHeader(
        layout=layout,
        observation_size=observation_size(layout, side * side, n_uavs),
        hidden_size=16,
        cells_per_side_min=side,
        cells_per_side_max=side,
        n_uavs_min=n_uavs,
        n_uavs_max=n_uavs,
        scenario='paper_10x10',
        fingerprint='0123456789abcdef',
        preset='paper',
        algorithm='aqmix',
        seed=3,
        decisions=1000,
        updates=100,
        version='test @ 100, 89abcdef',
        git_revision='unknown',
        validation=VALIDATION,
    )
    return replace(made, **values)  # type: ignore[arg-type]


def random_weights(of: PolicyHeader, seed: int = 0, scale: float = 1.0) -> Weights:
    """Weights drawn as torch draws them at first, uniformly, or larger."""
    rng = np.random.default_rng(seed)
    shapes = weight_shapes(of.observation_size, of.hidden_size)
    bounds = {'encoder': of.observation_size**-0.5}
    return {
        name: (
            rng.uniform(-1.0, 1.0, shape)
            * scale
            * bounds.get(name.split('.')[0], of.hidden_size**-0.5)
        ).astype(np.float32)
        for name, shape in shapes.items()
    }


def random_policy(of: PolicyHeader, seed: int = 0, scale: float = 3.0) -> FrozenPolicy:
    """A policy of random weights, large enough to prefer now this action, now that."""
    return FrozenPolicy(of, random_weights(of, seed, scale))


def saved(folder: Path, name: str, of: PolicyHeader, seed: int = 0) -> Path:
    """The file of a random policy."""
    path = folder / f'{name}.safetensors'
    save_policy(path, random_policy(of, seed))
    return path


def of_before(path: Path, **changed: str | None) -> Path:
    """A file as it was written when the digest covered the weights alone, with other texts."""
    policy = load_policy(path)
    with path.open('rb') as file:
        texts = read_head(file, path.stat().st_size).texts
    old = {**texts, 'format': WEIGHTS_FORMAT, 'digest': policy.digest, **changed}
    kept = {name: text for name, text in old.items() if text is not None}
    path.write_bytes(tensor_file(policy.weights, kept))
    return path
