"""What all measurements share: the machine, memory, optional packages, tables, charts."""
