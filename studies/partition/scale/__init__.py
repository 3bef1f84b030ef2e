"""Object scale: objects over the scale at which their hierarchy is cut, and their stability."""
