"""`ellipseg evaluate`: partitions of this package and of others, against truth."""
