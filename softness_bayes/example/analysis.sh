#!/bin/sh
# An analysis from two tables to a report. The tables beside this file are an EXAMPLE (simulated): replace their rows by
# yours, then run:  sh analysis.sh
# 'softness-bayes VERB --help' explains every option; remove results/ (or add --force) before you sample again.
set -e
cd "$(dirname "$0")"

# 1. How are the tables understood? Read the warnings and notes before anything else.
softness-bayes check --data ratings.csv --fabrics fabrics.csv

# 2. Sample the posterior: minutes. Ctrl-C keeps the run, and 'softness-bayes resume results' continues it.
#    --modulus-cv 0.1 says that the moduli were measured with errors of 10 %; 0 says that they are exact.
softness-bayes sample --data ratings.csv --fabrics fabrics.csv --out results --modulus-cv 0 --seed 1

# 3. One page about it: open results/report.html in a browser.
softness-bayes report results

# 4. Answers: ratings under another load, the order of the fabrics, the modulus that gives a rating of 20.
softness-bayes predict --posterior results --fabrics fabrics.csv --force-n 1 --out predicted.csv
softness-bayes rank results --fabrics fabrics.csv --force-n 1
softness-bayes target results --rating 20 --indentation-mm 2
