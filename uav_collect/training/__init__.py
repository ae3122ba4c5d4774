"""A training run on disk, without torch: its settings, folder, record and curves."""
