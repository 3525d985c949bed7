"""What docs/findings.md has for each claim, on our own scenes.

`scripts/documents.py` writes these figures from the files under `results/reference`, and a test
holds them against these.
"""

Q_RANKS_LANES = "0.996 (0.993 to 0.998)"
H_BEFORE_A_BY_LANES = "0.983 (0.961 to 0.993), A 0.869 (0.770 to 0.928)"
H_BEFORE_A_BY_TIME = "0.947 (0.907 to 0.974), A 0.873 (0.704 to 0.911)"
A_RANKS_TESTS = "1.000"
D_IS_LAST = "0.751 (0.521 to 0.794)"
H_AGAINST_EAR_CLIPPING = "0.859 of its time (city, 1024 px)"
H_AGAINST_DELAUNAY = "0.951 of its time (city, 1024 px)"
H_AGAINST_DELAUNAY_WALKED = "0.940 of its time (Helsinki, 1024 px); 1.000 on letters"
REGRET_OF_Q = "0.01 % (0.00 to 0.02) (city, 1024 px)"
H_TURNED = "0.92 at the worst angle (city, 512 px)"
A_TURNED = "0.99 at the worst angle (city, 512 px)"
