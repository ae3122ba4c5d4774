"""The pictures of studies, drawn from what their jobs found."""
