"""Learning, with torch: networks, replay, updates, and where experience comes from."""
