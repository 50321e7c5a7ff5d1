"""From layers to panels that can be made: trimming, edge beams, polygon files."""
