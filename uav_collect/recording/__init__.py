"""What missions leave on disk: logs, bags and their repair, mission folders."""
