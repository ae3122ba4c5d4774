"""The tool that asks a world to start or abort missions."""
