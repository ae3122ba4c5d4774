"""The files that a training job gives, as those read them who need no torch."""

POLICY = 'policy.safetensors'
CURVE = 'curve.csv'
SUMMARY = 'summary.json'

# A row for each validation. Of the training's own missions, which explore, what the last ones
# gave; for QMIX these are synchronous.
CURVE_COLUMNS = (
    'n_decisions', 'n_updates', 'training_reward', 'training_efficiency_kbit_per_j',
    'efficiency_kbit_per_j', 'completion_s', 'energy_kj', 'collected_share', 'complete_share',
    'safe_share', 'team_reward',
)  # fmt: skip
