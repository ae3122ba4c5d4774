"""The world node: flies the missions, tells the fleet and viewers."""
