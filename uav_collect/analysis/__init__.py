"""What mission logs say: metrics, statistics, tables and pictures."""
