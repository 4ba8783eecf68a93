# Studies of the levels of statistical tests. Needs the variables of the Makefile that includes it.

STUDY ?=
TABLE ?=
.PHONY: false-alarms
false-alarms: all $(TRUTH) ## how often tests reject what is right, into docs/explanation/false_alarms.md (hours; resumes; STUDY=... N=... TABLE=1)
	PYTHONPATH=benchmarks $(PY) tests/false_alarms/run_studies.py $(STUDY) --results $(BUILD)/false_alarms \
	    $(if $(filter-out file,$(origin N)),--seeds $(N),--page docs/explanation/false_alarms.md) $(if $(TABLE),--table)
