"""What the forward model costs and how wrong it is, measured on the machine at hand, beside other ways to compute it.

``softness-bayes bench`` runs all of it. Every number is of one core, of the scene and the prior draws of
`bench.subject`; the quickest of some repeated calls counts, the rest was other work of the machine.
"""
