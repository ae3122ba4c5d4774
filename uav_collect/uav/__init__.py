"""All that one UAV is, knows and decides by; it never sees the truth of `world`."""
