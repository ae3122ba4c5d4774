"""All that one UAV is, knows and decides by, on board; it never imports `world`."""
