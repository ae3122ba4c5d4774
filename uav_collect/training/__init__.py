"""A training run on disk: its settings, folder, record and curves; without torch."""
