"""The tool that asks a world to start, abort, pause or step missions, or to inject a fault."""
