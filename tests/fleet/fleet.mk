# Studies of `gsid fleet`. Needs the variables of the Makefile that includes it.

UNITS ?= 1000
FLEET_STUDY := PYTHONPATH=tests/fleet nice -n 10 $(PY) tests/fleet/fleet_study.py

.PHONY: fleet-study
fleet-study: all ## faults, overhead, scaling, memory and drifts of gsid fleet (UNITS=1000 SEED=1; an hour)
	$(FLEET_STUDY) faults --units $(UNITS) --seed $(SEED) --output $(BUILD)/fleet
	$(FLEET_STUDY) overhead --units 60 --output $(BUILD)/fleet
	$(FLEET_STUDY) scaling --units 60 --output $(BUILD)/fleet
	$(FLEET_STUDY) memory --units 100000 --output $(BUILD)/fleet
	PYTHONPATH=tests/fleet $(PY) tests/fleet/drift_study.py --seed $(SEED)
