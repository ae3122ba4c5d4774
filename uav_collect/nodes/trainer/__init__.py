"""The trainer node: learns from what the fleet reports."""
