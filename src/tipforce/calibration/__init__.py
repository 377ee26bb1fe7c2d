"""What a bench is, from its own recordings: sensor pose, moving mass, knob map, stiffness, tissue; and its camera."""
