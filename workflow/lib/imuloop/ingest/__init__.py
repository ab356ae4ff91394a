"""From a source to the canonical samples: sources, readers, quality."""
