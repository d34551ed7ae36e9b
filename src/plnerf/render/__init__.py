"""From a field to pictures: samples along rays, the rendering sum, whole views."""
