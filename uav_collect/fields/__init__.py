"""From a list of loggers to a scenario: cells, base and fleet proposed, the file and its map."""
