# The study of `gsid start` on simulated axes. Needs the variables of the Makefile that includes it.

.PHONY: start-study
start-study: all $(TRUTH) ## structures of simulated axes, into docs/explanation/linear_structure.md (N=100 SEED=1; an hour; resumes)
	PYTHONPATH=tests/structure:tests/blind nice -n 10 $(PY) tests/structure/start_study.py --results $(BUILD)/start_study \
	    --trials $(N) --seed $(SEED) --processes 2 --page docs/explanation/linear_structure.md
