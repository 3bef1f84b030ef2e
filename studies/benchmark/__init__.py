"""`ellipseg bench`: what an update costs, beside what it is compared with, in the same run."""
