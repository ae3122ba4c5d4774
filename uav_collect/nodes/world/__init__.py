"""The world node: simulates missions, and publishes them to the fleet and to viewers."""
