"""A surveyed line, a conductor and loads in; the line at other temperatures, in wind and under ice out."""
