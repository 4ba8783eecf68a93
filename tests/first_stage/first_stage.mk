# Studies of the first stage of the diagnosis, and of the diagnosis from records. Needs the variables of the Makefile that includes it.

.PHONY: first-stage-study
first-stage-study: all $(TRUTH) ## how often the first stage ranks and names the right law, into docs/explanation/missing_torque.md (an hour; resumes; SEED=... SINGLES=... NULLS=... FOREIGN=...)
	PYTHONPATH=tests/blind $(PY) tests/first_stage/first_stage_study.py --folder $(BUILD)/first_stage \
	    $(if $(filter-out file,$(origin SEED)),--seed $(SEED)) $(SINGLES:%=--singles %) $(NULLS:%=--nulls %) \
	    $(FOREIGN:%=--foreign %) --page docs/explanation/missing_torque.md

STARTS ?= 5 30 records
.PHONY: from-records-study
from-records-study: all $(TRUTH) ## how often the diagnosis from records is right from three starts, into docs/explanation/from_records.md (hours; resumes; SEED="1 2" N=20 NULLS=... FOREIGN=0 STARTS="5 30 records")
	PYTHONPATH=tests/blind:tests/first_stage nice -n 10 $(PY) tests/first_stage/from_records_study.py \
	    --results $(BUILD)/from_records_study.jsonl --starts $(STARTS) \
	    $(if $(filter-out file,$(origin SEED)),--seed $(SEED)) $(if $(filter-out file,$(origin N)),--n $(N)) \
	    $(NULLS:%=--nulls %) $(FOREIGN:%=--foreign %) --page docs/explanation/from_records.md \
	    --picture docs/pictures/reliability.png

.PHONY: from-records-times
from-records-times: all $(TRUTH) ## time of each step of the diagnosis from records, on a computer that does nothing else, into docs/explanation/from_records.md (20 minutes; resumes; SEED=5150 N=100 BEFORE=FILE)
	PYTHONPATH=tests/blind:tests/first_stage $(PY) tests/first_stage/times_study.py --results $(BUILD)/from_records_times.jsonl \
	    $(if $(filter-out file,$(origin SEED)),--seed $(SEED)) $(if $(filter-out file,$(origin N)),--n $(N)) \
	    $(BEFORE:%=--before %) --page docs/explanation/from_records.md

.PHONY: diagnosis-probability-study
diagnosis-probability-study: all $(TRUTH) ## the coefficients of the stated probabilities, from development trials, into docs/explanation/from_records.md (half an hour; resumes; SEED=501 N=80 NULLS=12 FOREIGN=20)
	PYTHONPATH=tests/blind:tests/first_stage nice -n 10 $(PY) tests/first_stage/probability_study.py \
	    --results $(BUILD)/diagnosis_probability.jsonl $(if $(filter-out file,$(origin SEED)),--seed $(SEED)) \
	    $(if $(filter-out file,$(origin N)),--n $(N)) $(NULLS:%=--nulls %) $(FOREIGN:%=--foreign %) \
	    --page docs/explanation/from_records.md

.PHONY: missing-linear-study
missing-linear-study: all $(TRUTH) ## how often a linear effect that a model lacks is named, into docs/explanation/missing_torque.md (two hours; resumes; SEED=5300 N=100)
	PYTHONPATH=tests/blind:tests/first_stage nice -n 10 $(PY) tests/first_stage/missing_linear_study.py --folder $(BUILD)/missing_linear \
	    $(if $(filter-out file,$(origin SEED)),--seed $(SEED)) $(if $(filter-out file,$(origin N)),--trials $(N)) --processes 2 --page docs/explanation/missing_torque.md

.PHONY: linear-names-study
linear-names-study: all $(TRUTH) ## how often a linear effect is named where none is missing, into docs/explanation/missing_torque.md (half an hour; resumes; SEED=5400 N=60)
	PYTHONPATH=tests/blind:tests/first_stage nice -n 10 $(PY) tests/first_stage/linear_names_study.py --folder $(BUILD)/linear_names \
	    $(if $(filter-out file,$(origin SEED)),--seed $(SEED)) $(if $(filter-out file,$(origin N)),--trials $(N)) --page docs/explanation/missing_torque.md

.PHONY: diagnosis-settings-study
diagnosis-settings-study: all $(TRUTH) ## which verdicts change if a constant of the diagnosis is halved or doubled, into docs/explanation/from_records.md (half an hour; resumes)
	PYTHONPATH=tests/blind:tests/first_stage nice -n 10 $(PY) tests/first_stage/settings_sweep.py \
	    --results $(BUILD)/diagnosis_settings.jsonl --page docs/explanation/from_records.md

.PHONY: measured-subsets
measured-subsets: all $(TRUTH) ## the diagnosis of random subsets of the measured records, into docs/explanation/from_records.md (half an hour; resumes; SEED=... N=...)
	PYTHONPATH=tests/blind:tests/first_stage:tests nice -n 10 $(PY) tests/first_stage/measured_subsets.py \
	    --results $(BUILD)/measured_subsets.jsonl $(if $(filter-out file,$(origin SEED)),--seed $(SEED)) \
	    $(if $(filter-out file,$(origin N)),--n $(N)) --page docs/explanation/from_records.md
