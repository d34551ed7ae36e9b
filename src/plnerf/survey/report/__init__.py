"""A survey as a report: one HTML page and survey.json."""
