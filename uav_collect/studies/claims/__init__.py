"""What the paper and the project claim, judged by what was measured."""
