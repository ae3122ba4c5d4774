"""The recorder node: writes what is published to a bag."""
