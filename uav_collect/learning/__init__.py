"""Learning, with torch: networks, replay, updates, and where missions come from."""
