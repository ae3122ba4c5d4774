"""Functions that run compiled or interpreted to the same bits, their rows, and keyed draws."""
