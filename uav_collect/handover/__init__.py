"""Flights for the tools of others: ground stations, maps of the Earth, tables."""
