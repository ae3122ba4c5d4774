"""The agent node: flies one UAV."""
