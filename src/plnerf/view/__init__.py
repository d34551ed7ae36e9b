"""A run, a scene or a survey in, a page in a browser out: see, fly along, measure, save.  Needs viser."""
