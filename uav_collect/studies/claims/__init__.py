"""What the paper claims, judged by what was measured."""
