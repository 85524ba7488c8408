"""Time and error of the forward model on this machine, compared with other ways to compute it.

``softness-bayes bench`` runs all of it. Every number is for one core, with the scene and the prior draws of
`bench.subject`. The time reported is the shortest of several calls, the one least disturbed by other work.
"""
