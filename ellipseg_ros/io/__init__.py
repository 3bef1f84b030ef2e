"""Reading of bags and cloud files as sweeps, and writing of messages, bags and files.

Messages are written in their serialized form (CDR), which publishers and bags accept and numpy
produces in bulk. So nothing here needs the generated message classes.
"""
