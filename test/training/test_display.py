"""What a training says of itself while it runs."""

from dataclasses import replace

from uav_collect.training.display import efficiencies
from uav_collect.training.progress import Progress, ValidationResult

WHOLE = ValidationResult(
    wall_s=1.0,
    n_decisions=1000,
    n_updates=10,
    efficiency_kbit_per_j=0.153,
    completion_s=300.0,
    energy_kj=80.0,
    collected_share=1.0,
    complete_share=1.0,
    safe_share=1.0,
    team_reward=90.0,
)
PARTIAL = replace(WHOLE, efficiency_kbit_per_j=0.206, collected_share=0.98, complete_share=2 / 3)


def progress(best: ValidationResult | None) -> Progress:
    return Progress(
        share_done=0.5,
        wall_s=1.0,
        n_decisions=1000,
        n_updates=10,
        n_missions=10,
        decisions_per_s=1000.0,
        updates_per_s=10.0,
        loss=0.1,
        mean_value=1.0,
        gradient_norm=1.0,
        epsilon=0.1,
        learning_rate=1e-4,
        training_efficiency_kbit_per_j=0.25,
        training_reward=1.0,
        replay_transitions=1000,
        replay_bytes=10_000,
        validation=best,
        best=best,
    )


def test_a_policy_that_leaves_missions_unfinished_says_so_beside_its_efficiency() -> None:
    texts = efficiencies(progress(best=WHOLE), PARTIAL)
    assert texts == ('0.250 kbit/J exploring', '0.206 (66 % complete) validated', '0.153 best')


def test_before_the_first_validation_there_is_no_best() -> None:
    assert efficiencies(progress(best=None), None) == (
        '0.250 kbit/J exploring',
        'not validated yet',
    )
