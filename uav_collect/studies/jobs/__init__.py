"""Jobs of a study, and who does them: processes of this machine or a cluster."""
