"""The viewer: a page for browsers that shows missions in flight."""
