"""YAML files: text with positions, files that extend each other, rules of values."""
