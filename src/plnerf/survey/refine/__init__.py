"""Catenaries fitted to the images themselves."""
