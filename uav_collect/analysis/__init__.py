"""What missions achieved: metrics from their logs, statistics, tables and pictures."""
