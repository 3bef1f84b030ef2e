"""Tuning constants of the association, with their units and reasons."""

import numpy as np

# Candidates
BOUND_SIGMAS = 4.0  # standard deviations taken as the bound of an error, so as to miss no pair
MAX_CANDIDATES = 2_000_000  # each costs memory; so many similar landmarks identify nothing
CLUTTER_PRIOR_PAIRS = 2.0  # pairs that the bounds count for in the clutter of a kind

# Consistency graph
MAX_GRAPH_CANDIDATES = 600  # vertices: its adjacency matrix is dense
MAX_CONSISTENT_SQUARE = 16.0  # squared Mahalanobis residual that two consistent candidates leave
CONSISTENCY_MARGIN = 1.5  # by which the motion of two consistent candidates may exceed the bounds
MAX_CLIQUES = 24  # each costs a registration
MIN_CLIQUE_SHARE = 0.5  # of the pairs of a known hypothesis: a smaller clique is no rival to it

# Registration
MAX_STEPS = 10  # of Gauss-Newton; 3 or 4 suffice
STEP_TOLERANCE = 1e-6  # m, rad: a smaller step is the last
MAX_INFORMATION = 1e30  # 1/m^2, 1/rad^2: beyond is rounding, as the noise of a pair has a floor
GATES = np.array([16.27, 18.47, 16.27])  # by kind: 99.9 % of chi^2 with 3, 4, 3 degrees of freedom
MAX_REFINEMENTS = 8  # rounds of registration and matching
BOUND_MARGIN = 1.1  # by which a transform may exceed the bounds

# Verdict
CHANCE_EVIDENCE = 5.0  # log odds that chance produces now and then
MIN_TRANSFORM_PROBABILITY = 0.95  # of a transform that is not ambiguous
MAX_LOG_ODDS = 50.0  # beyond, exp only overflows
RIVAL_DECAY = 8.0  # a rival with the share 1 - x of the best one's support has odds of exp(-8 x)
