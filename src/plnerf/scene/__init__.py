"""The scene folder: images, cameras, frames."""
