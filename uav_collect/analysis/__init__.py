"""What mission logs tell: metrics, statistics, tables and pictures."""
