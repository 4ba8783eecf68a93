# The study of interrupted runs. Needs the variables of the Makefile that includes it.

.PHONY: interrupted-runs
interrupted-runs: all ## end gsid run 20 times in each of eight ways, into docs/how-to/interrupted_runs.md (minutes; resumes)
	$(PY) tests/interrupted/study.py --results $(BUILD)/interrupted_runs.jsonl --page docs/how-to/interrupted_runs.md
