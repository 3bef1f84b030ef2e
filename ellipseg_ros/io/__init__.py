"""Points in, segments out: ROS messages, bags, cloud files; each one a source of sweeps.

Messages are written as the bytes of their serialized form (CDR): a publisher takes them, a bag
takes them, and numpy makes them in bulk. So nothing here needs the generated message classes.
"""
