"""An avatar in motion, for other programs: splats, strands, scenes."""
