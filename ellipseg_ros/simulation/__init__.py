"""What the simulator is made of: shapes, rays, the scanner's path, things, scenes."""
