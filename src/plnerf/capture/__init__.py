"""From photos or video to a posed, georeferenced scene."""
