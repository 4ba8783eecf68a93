# Studies of `gsid start` and `gsid fit` on simulated axes. Needs the variables of the Makefile that includes it.

.PHONY: start-study
start-study: all $(TRUTH) ## structures of simulated axes, into docs/explanation/linear_structure.md (N=100 SEED=1; an hour; resumes)
	PYTHONPATH=tests/structure:tests/blind nice -n 10 $(PY) tests/structure/start_study.py --results $(BUILD)/start_study \
	    --trials $(N) --seed $(SEED) --processes 2 --page docs/explanation/linear_structure.md

.PHONY: fit-coverage
fit-coverage: all $(TRUTH) ## intervals of fits of axes with friction, into docs/explanation/estimators.md (N=300 SEED=1; ten minutes)
	OPENBLAS_NUM_THREADS=1 PYTHONPATH=tests/structure:tests/blind nice -n 10 $(PY) tests/structure/fit_coverage.py \
	    --trials $(N) --seed $(SEED) --page docs/explanation/estimators.md
